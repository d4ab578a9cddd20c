"""An encoder of points, trained, exported and measured by the commands of `hof-model`."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model import cli
from model.config import ON_CPU, EncoderConfig
from model.data.dataset import draw_batch, load_examples
from model.evaluation.evaluate import cases
from model.evaluation.paper.completion import complete, training_part
from model.training.checkpoints import chosen_checkpoint, load_encoder
from model.training.device.loop import train_on_device
from model.training.state import RunState
from model.training.train import train, train_step
from service.encoding.clouds import MOST_POINTS
from service.encoding.encoder import Encoder
from tests.support.small.runs import RUN, export_run, records

pytestmark = pytest.mark.slow

ENCODER = EncoderConfig(trunk="pointnet", point_maps=(16, 32, 32, 64), fully_connected=(32,), rank=8)
POINTS_RUN = replace(RUN, encoder=ENCODER, turn=30.0)
GRID = EncoderConfig(trunk="grid", feature_maps=(8, 8), convolutions=2, fully_connected=(32,), rank=8)


@pytest.fixture(scope="module")
def run(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return train(built, tmp_path_factory.mktemp("points"), POINTS_RUN).parent


@pytest.fixture(scope="module")
def exported(run: Path, built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("weights") / "small-points.onnx"
    return export_run(run, built, output)


def test_train_step_on_parts_repeated_lowers_the_loss(built: Path) -> None:
    examples = load_examples(built, "train", POINTS_RUN.framing)
    state = RunState(POINTS_RUN)
    with ThreadPoolExecutor(2) as threads:
        losses = [
            train_step(state, draw_batch(examples, POINTS_RUN, step), 0.1, threads, parts=2) for step in range(150)
        ]
    assert np.mean(losses[-10:]) < 0.5 * np.mean(losses[:10])


def test_draw_batch_of_parts_is_a_function_of_seed_and_step(built: Path) -> None:
    examples = load_examples(built, "train", POINTS_RUN.framing)
    first, again, other = (draw_batch(examples, POINTS_RUN, step) for step in (3, 3, 4))
    assert torch.equal(first.images, again.images)
    assert torch.equal(first.points, again.points)
    assert first.scale is not None
    assert not torch.equal(first.points, other.points)
    assert first.images.shape[::2] == (POINTS_RUN.batch, 3)
    assert 64 <= first.images.shape[1] <= MOST_POINTS
    # the part lies on the object, in the object's scale
    parts = first.images * first.scale
    assert torch.cdist(parts, first.points).amin(2).mean() < 0.06


def test_train_on_device_learns_from_parts(built: Path, tmp_path: Path) -> None:
    train_on_device(built, tmp_path, replace(POINTS_RUN, steps=10), ON_CPU)
    _, config, spent = load_encoder(tmp_path / "last.pt")
    assert (config.encoder, spent["step"]) == (ENCODER, 10)
    losses = [record["loss"] for record in records(tmp_path) if "loss" in record]
    assert np.isfinite(losses).all()
    assert "f@1%" in records(tmp_path)[-1]


def test_exported_run_of_points_describes_itself(exported: Path, run: Path) -> None:
    encoder = Encoder.open(exported, 1)
    assert (encoder.takes, encoder.count, encoder.spec) == ("points", MOST_POINTS, POINTS_RUN.spec)
    assert set(encoder.card["figures"]) == {"small-points"}
    assert "turned by up to 30 degrees" in encoder.card["limits"][0]
    page = exported.with_suffix(".md").read_text()
    assert "points of a part of an object -> theta" in page
    trained, _, spent = load_encoder(chosen_checkpoint(run))
    again, config, same = load_encoder(exported)
    assert (config, same["step"]) == (POINTS_RUN, spent["step"])
    for name, value in trained.state_dict().items():
        assert torch.equal(again.state_dict()[name], value.half().float() if value.dim() > 1 else value), name


def test_run_on_a_grid_of_stretched_objects_trains_and_is_exported(built: Path, tmp_path: Path) -> None:
    config = replace(POINTS_RUN, encoder=GRID, turn=0.0, stretch=1.4, steps=8)
    train(built, tmp_path, config)
    encoder = Encoder.open(export_run(tmp_path, built, tmp_path / "small-grid.onnx"), 1)
    assert (encoder.takes, encoder.count) == ("points", MOST_POINTS)
    assert "stretched" in encoder.card["limits"][0]
    part = training_part(next(iter(cases(built, "test"))), 0)
    assert np.isfinite(complete(encoder, part, 500)).all()
    assert not np.allclose(complete(encoder, part, 500), complete(encoder, 1.5 * part, 500), atol=1e-3)


def test_complete_gives_the_object_in_the_frame_of_the_part(exported: Path, built: Path) -> None:
    encoder, case = Encoder.open(exported, 1), next(iter(cases(built, "test")))
    part = training_part(case, 0)
    points = complete(encoder, part, 500, steps=0)  # steps enlarge rounding
    moved = complete(encoder, 3 * part + np.array([1, 2, 3], np.float32), 500, steps=0)
    np.testing.assert_allclose(moved, 3 * points + [1, 2, 3], atol=1e-2)


def test_train_with_a_wrong_number_of_point_maps_fails(
    built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flags = ["--trunk", "pointnet", "--point-maps", "8", "8", "8", "--data", str(built), "--run", str(tmp_path / "run")]
    assert cli.main(["train", *flags]) == 2
    assert "point_maps has 3 widths, PointNet has 4 layers" in capsys.readouterr().err
