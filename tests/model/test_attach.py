"""Heads attached to an exported model: the commands, the file, and its other outputs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model import cli
from model.cli.common import SHIPPED
from model.evaluation.estimates.trials import EstimateTrials
from model.evaluation.locations import ESTIMATES
from model.export import attach, export
from model.networks.color_head import ColorHead, color_spec, look
from model.networks.encoder import ImageEncoder
from model.networks.estimate_heads import EstimateHeads
from model.networks.inner import InnerEncoder
from model.report.estimates import section
from service.encoding.encoder import Encoder
from tests.support.small import data as small_data
from tests.support.small.network import CONFIG


@pytest.fixture
def plain(tmp_path: Path) -> Path:
    """Export a small model with color."""
    encoder = ImageEncoder(CONFIG.spec, CONFIG.encoder, CONFIG.framing.size).eval()
    inputs = look(encoder, torch.zeros(1, 3, CONFIG.framing.size, CONFIG.framing.size))[1].shape[1]
    card = {"name": "small", "training": {"minutes": 0, "steps": 0, "config": CONFIG.to_dict()}}
    card |= {"data": {"objects": {"train": 0, "val": 0, "test": 0}, "licences": []}, "figures": {}, "limits": []}
    card |= {"exported": {"date": "d", "machine": "m", "commit": "c"}, "trunk": "t", "method": "m", "license": "l"}
    path = tmp_path / "plain.onnx"
    export(encoder, CONFIG, card, path, ColorHead(color_spec(CONFIG.spec), inputs).eval())
    return path


def _heads(file: Path) -> EstimateHeads:
    inner = InnerEncoder(file, threads=1)
    tensors = inner.look(np.zeros((1, 3, inner.size, inner.size), np.float32))[1]
    return EstimateHeads({name: array.shape[1:] for name, array in tensors.items()}, members=2).eval()


@pytest.mark.slow
def test_attach_adds_estimates_and_changes_nothing_else(plain: Path, tmp_path: Path) -> None:
    output = tmp_path / "with.onnx"
    differences = attach(plain, _heads(plain), {"name": "small"}, output)
    assert differences["theta: file - file"] == differences["color: file - file"] == 0
    before, after = Encoder.open(plain, 1), Encoder.open(output, 1)
    assert after.outputs == before.outputs | {"shape_confidence": [1], "camera": [4]}
    images = np.random.default_rng(1).random((3, 3, 32, 32), np.float32)
    for one, other in zip(before.encode(images), after.encode(images), strict=True):
        np.testing.assert_array_equal(one.theta, other.theta)
        assert other.estimates
        assert 0 <= other.estimates.shape_confidence <= 1
        assert -180 <= other.estimates.camera.azimuth <= 180


@pytest.mark.slow
def test_attach_again_replaces_the_heads(plain: Path, tmp_path: Path) -> None:
    one, two = tmp_path / "one.onnx", tmp_path / "two.onnx"
    attach(plain, _heads(plain), {"name": "small"}, one)
    heads = _heads(one)
    attach(one, heads, {"name": "small"}, two)
    assert abs(two.stat().st_size - one.stat().st_size) < 200
    assert Encoder.open(two, 1).outputs == Encoder.open(one, 1).outputs


@pytest.mark.slow
@pytest.mark.parametrize("name", ["hof1-k2", "hof1-k4"])
def test_attach_to_the_shipped_models_stays_within_30_mb(name: str, tmp_path: Path) -> None:
    file, output = SHIPPED.parent / f"{name}.onnx", tmp_path / "with.onnx"
    attach(file, _heads(file), Encoder.open(file, 1).card, output)
    assert output.stat().st_size < 30_000_000


@pytest.mark.system
@pytest.mark.slow
def test_commands_heads_and_estimates_train_and_measure(
    plain: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = small_data.write(tmp_path / "data", train=2, test=3)
    others = small_data.write(tmp_path / "others", train=0, test=4)
    output, observations = tmp_path / "with.onnx", tmp_path / "seen.npz"
    command = ["heads", "--model", str(plain), "--data", str(data), "--others", str(others), "-o", str(output)]
    flags = ["--observations", str(observations), "--views", "4", "--epochs", "1", "--members", "2"]
    assert cli.main([*command, *flags]) == 0
    assert observations.exists()
    assert f"{output}: " in capsys.readouterr().out
    assert "Shape confidence and camera" in output.with_suffix(".md").read_text()
    assert Encoder.open(output, 1).card["estimates"]["objects"] == 6
    measured = ["estimates", "--model", str(output), "--data", str(data), "--out", str(tmp_path)]
    assert cli.main(measured) == 0
    record = EstimateTrials.read(tmp_path / ESTIMATES / "small.json")
    assert section(record) in capsys.readouterr().out
    assert [each.source for each in record.sources] == ["test"]
    assert (tmp_path / ESTIMATES / "small.png").exists()
    assert all(0 <= value <= 1 for values in record.strange.values() for value in values)


@pytest.mark.slow
def test_estimates_of_a_model_without_heads_says_what_to_do(
    plain: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = small_data.write(tmp_path / "data", train=1, test=1)
    assert cli.main(["estimates", "--model", str(plain), "--data", str(data), "--out", str(tmp_path)]) == 2
    assert "makes no estimates: run `hof-model heads`" in capsys.readouterr().err


def test_section_counts_only_objects_that_are_not_symmetric() -> None:
    from tests.support.small.trials import estimate_trials

    record = estimate_trials()
    one = replace(record.sources[0], turned=[0.0, 0.1])
    assert one.azimuth_errors().tolist() == [5.0, 170.0]
    text = section(replace(record, sources=[one]))
    assert "| test (2) | 4 |" in text
    assert "87.5°" in text
