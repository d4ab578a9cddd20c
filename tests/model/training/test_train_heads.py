"""Training of heads on made-up observations whose answer is known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model.config import HeadsConfig
from model.networks.estimate_heads import BINS
from model.networks.observations import TURNS_DEG, Observations
from model.training.train_heads import azimuth_targets, calibrate, train_heads

CONFIG = HeadsConfig(epochs=60, members=3)
OBJECTS, VIEWS, WIDTH = 60, 8, 12


def _observations(seed: int = 0) -> Observations:
    """Return observations whose code holds the score, the direction of the camera, and noise."""
    rng = np.random.default_rng(seed)
    objects = np.repeat(np.arange(OBJECTS), VIEWS)
    azimuths = rng.uniform(-180, 180, len(objects))
    elevations, distances, rolls = (
        rng.uniform(low, high, len(objects)) for low, high in ((0.0, 45.0), (1.5, 5.0), (-10.0, 10.0))
    )
    scores = np.clip(rng.uniform(0.1, 0.9, OBJECTS)[objects] + rng.normal(0, 0.03, len(objects)), 0, 1)
    code = rng.normal(size=(len(objects), WIDTH))
    code[:, :6] = np.stack(
        [
            4 * scores - 2,
            np.sin(np.radians(azimuths)),
            np.cos(np.radians(azimuths)),
            elevations / 20,
            np.log(distances),
            rolls / 10,
        ],
        axis=1,
    )
    return Observations(
        {"code": code.astype(np.float16)},
        scores.astype(np.float32),
        np.stack([azimuths, elevations, distances, rolls], axis=1).astype(np.float32),
        objects,
        np.array([f"o{number}" for number in range(OBJECTS)]),
        np.array(["s"] * OBJECTS),
        np.full((OBJECTS, len(TURNS_DEG)), 0.1, np.float32),
    )


@pytest.mark.slow
def test_train_heads_learns_the_score_and_the_camera() -> None:
    heads, unseen = train_heads(_observations(), CONFIG), _observations(1)
    with torch.no_grad():
        confidence, camera = heads(torch.from_numpy(unseen.inner["code"].astype(np.float32)))
    assert np.corrcoef(confidence[:, 0], unseen.scores)[0, 1] > 0.9
    assert np.abs(confidence[:, 0].numpy() - unseen.scores).mean() < 0.08
    away = np.abs((camera.numpy() - unseen.cameras + [[180, 0, 0, 0]]) % [[360, 1e9, 1e9, 1e9]])
    away[:, 0] = np.abs((camera[:, 0].numpy() - unseen.cameras[:, 0] + 180) % 360 - 180)
    assert np.median(away[:, 0]) < 12
    rest = np.abs(camera.numpy() - unseen.cameras)[:, 1:]
    assert (np.median(rest, axis=0) < [5, 0.6, 3]).all()


def test_train_heads_twice_gives_the_same_weights() -> None:
    config = replace(CONFIG, epochs=1)
    one, other = (train_heads(_observations(), config).state_dict() for _ in range(2))
    assert all(torch.equal(value, other[name]) for name, value in one.items())


def test_train_heads_without_scores_is_refused() -> None:
    unscored = replace(_observations(), scores=np.full(OBJECTS * VIEWS, np.nan, np.float32))
    with pytest.raises(ValueError, match="nothing to learn from: no object that the encoder was not trained on"):
        train_heads(unscored, CONFIG)


def test_azimuth_targets_of_a_symmetric_object_have_as_many_hills() -> None:
    plain = _observations()
    cameras = plain.cameras.copy()
    cameras[:, 0] = 30
    cameras[0, 0] = np.nan
    turned = plain.turned.copy()
    turned[1, TURNS_DEG.index(180)] = 0.005  # the same after half a turn
    turned[2] = 0.005  # round
    targets, counts = azimuth_targets(replace(plain, cameras=cameras, turned=turned))
    at, opposite = 30 * BINS // 360, 210 * BINS // 360
    assert targets[1].argmax() == at
    assert targets[VIEWS, at] == pytest.approx(targets[VIEWS, opposite].item())
    assert counts[: 3 * VIEWS : VIEWS].tolist() == [0, 1, 0]  # unknown, known, round
    assert targets.sum(dim=1) == pytest.approx(1, abs=1e-5)


def test_calibrate_takes_out_overconfidence() -> None:
    true = torch.linspace(-1, 1, 200)
    a, b = calibrate(3 * true + 0.5, torch.sigmoid(true))
    assert (a.item(), b.item()) == pytest.approx((-0.5 / 3, 1 / 3), abs=0.05)


def test_observations_written_read_back_equal(tmp_path: Path) -> None:
    observations = _observations()
    observations.write(tmp_path / "o.npz")
    again = Observations.read(tmp_path / "o.npz")
    assert len(again) == len(observations)
    np.testing.assert_array_equal(again.inner["code"], observations.inner["code"])
    for name in ("scores", "cameras", "objects", "ids", "sources", "turned"):
        np.testing.assert_array_equal(getattr(again, name), getattr(observations, name))
    np.savez(tmp_path / "other.npz", x=1)
    with pytest.raises(ValueError, match="holds no observations"):
        Observations.read(tmp_path / "other.npz")
