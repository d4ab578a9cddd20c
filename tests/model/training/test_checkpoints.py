"""Checkpoints and exported models of the version before: they load and give the same theta."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from model.cli.common import SHIPPED
from model.config import EncoderConfig, TrainConfig
from model.training.checkpoints import load_encoder, load_network
from model.training.state import RunState
from tests.support.small import network as small_network

BEFORE = Path(__file__).with_name("checkpoint_0_1.pt")  # seed 0, nothing learned; written by version 0.1.0
PLACES = [0, 1, 100, -1]
THETAS = {  # of two random images, as version 0.1.0 gave them: the norm, and the numbers at PLACES
    SHIPPED: [
        (42.112061, [0.280166, -0.130335, 0.040832, 0.005266]),
        (41.757820, [0.115616, -0.266183, 0.024530, 0.005323]),
    ],
    SHIPPED.with_name("hof1-k4.onnx"): [
        (27.852848, [-0.025136, -0.197015, 0.033932, 0.030367]),
        (28.220390, [-0.035193, -0.259316, 0.041577, 0.031436]),
    ],
    BEFORE: [
        (4.146438, [0.186231, -0.256209, -0.098990, 0.016826]),
        (4.146410, [0.186075, -0.255986, -0.098978, 0.016867]),
    ],
}
TOLERANCE = 1e-4  # absolute; machines differ by rounding

Change = Callable[[dict[str, Any]], object]


@pytest.mark.parametrize("file", THETAS, ids=lambda file: file.name)
def test_load_encoder_of_the_version_before_gives_the_same_theta(file: Path) -> None:
    encoder, config, _ = load_encoder(file)
    side = config.framing.size
    images = torch.from_numpy(np.random.default_rng(0).random((2, 3, side, side), np.float32))
    with torch.no_grad():
        thetas = encoder(images).numpy()
    for theta, (norm, numbers) in zip(thetas, THETAS[file], strict=True):
        assert theta[PLACES] == pytest.approx(numbers, abs=TOLERANCE)
        assert np.linalg.norm(theta) == pytest.approx(norm, abs=10 * TOLERANCE)


def test_resume_of_the_version_before_keeps_its_state(tmp_path: Path) -> None:
    (tmp_path / "last.pt").write_bytes(BEFORE.read_bytes())
    state = RunState.resume(tmp_path, small_network.CONFIG)
    assert (state.step, state.elapsed_s, state.best) == (7, 1.5, 0.25)
    assert state.config.encoder == small_network.CONFIG.encoder


def changed(tmp_path: Path, change: Change) -> Path:
    """Write a copy of the checkpoint with a change and return its path."""
    saved = torch.load(BEFORE, weights_only=True)
    change(saved)
    torch.save(saved, tmp_path / "changed.pt")
    return tmp_path / "changed.pt"


def halve(saved: dict[str, Any]) -> None:
    """Make of it what a script on a GPU writes: averaged matrices as float16, no optimizer, no runs before."""
    for key in ("before", "network", "optimizer", "best"):
        del saved[key]
    saved["average"] = {name: value.half() if value.dim() > 1 else value for name, value in saved["average"].items()}
    saved["figures"] = [0.5]


def test_load_network_with_half_matrices_rounds_them(tmp_path: Path) -> None:
    network, config, spent = load_network(changed(tmp_path, halve))
    exact = load_network(BEFORE)[0].state_dict()
    assert (config, spent) == (load_network(BEFORE)[1], {"step": 7, "elapsed_s": 1.5})
    for name, value in network.state_dict().items():
        assert value.dtype == exact[name].dtype
        assert torch.equal(value, exact[name].half().to(value.dtype) if value.dim() > 1 else exact[name]), name


@pytest.mark.parametrize(
    "change",
    [
        lambda saved: saved["config"].update(device="cuda"),
        lambda saved: [saved["config"].pop(name) for name in ("own_share", "made", "late_points")],
        lambda saved: [saved["config"]["encoder"].pop(name) for name in ("trunk", "frozen", "fine_maps")],
    ],
    ids=["unknown field of the run", "missing fields of the run", "missing fields of the encoder"],
)
def test_load_network_of_another_versions_config_takes_defaults(change: Change, tmp_path: Path) -> None:
    assert load_network(changed(tmp_path, change))[1] == load_network(BEFORE)[1]


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda saved: saved["config"]["encoder"].update(heads=2), "unusable encoder .* 'heads'"),
        (lambda saved: saved["config"].pop("framing"), "'framing'"),
    ],
)
def test_load_network_of_an_unknown_network_is_refused(change: Change, problem: str, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=f"changed.pt is no checkpoint of `hof-model train`: .*{problem}"):
        load_network(changed(tmp_path, change))


def test_config_from_its_dict_is_the_same() -> None:
    config = TrainConfig(encoder=EncoderConfig((4, 5), 2, (8,), 0), seed=5, projection=0.01, start="x.pt")
    assert TrainConfig.from_dict(config.to_dict()) == config
