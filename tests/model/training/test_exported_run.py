"""A run as an exported file: a checkpoint again, with a card, that the service reads."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model.evaluation.evaluate import predict
from model.export import parity
from model.training.checkpoints import chosen_checkpoint, load_encoder, load_network
from model.training.state import RunState
from service.encoding.encoder import Encoder
from service.errors import InvalidModel
from tests.support.small import model as tiny_model
from tests.support.small.runs import RUN

pytestmark = pytest.mark.slow


def test_load_encoder_of_an_exported_run_gives_its_rounded_weights(run: Path, exported: Path) -> None:
    encoder, config, before = load_encoder(chosen_checkpoint(run))
    again, same, spent = load_encoder(exported)
    assert same == config
    assert spent["step"] == before["step"]
    assert spent["elapsed_s"] == pytest.approx(before["elapsed_s"], abs=3)  # the card has tenths of minutes
    for name, value in encoder.state_dict().items():
        if not name.endswith("num_batches_tracked"):
            rounded = value.half().float() if value.dim() > 1 else value
            assert torch.equal(again.state_dict()[name], rounded), name
    started = RunState.begin(replace(RUN, start=str(exported)))
    assert torch.equal(started.network.state_dict()["encoder.head.linear.weight"], again.head.linear.weight)


def test_load_network_of_an_unusable_onnx_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "other.onnx").write_bytes(b"no ONNX")
    with pytest.raises(InvalidModel, match="unusable"):
        load_network(tmp_path / "other.onnx")
    with pytest.raises(ValueError, match="does not tell how it was trained"):
        load_network(tiny_model.build(tmp_path / "tiny.onnx"))


def test_exported_run_describes_itself(exported: Path) -> None:
    encoder = Encoder.open(exported, 1)
    assert (encoder.name, encoder.spec, encoder.framing) == ("small-k2", RUN.spec, RUN.framing)
    assert encoder.card["training"]["steps"] > 0
    assert set(encoder.card["figures"]) > {"small-k2", "mean shape", "image retrieval", "oracle nearest neighbor"}
    page = exported.with_suffix(".md").read_text()
    assert "image retrieval" in page
    assert f"{exported.stat().st_size:,} bytes" in page


def test_exported_matrices_take_half_the_bytes(exported: Path, run: Path) -> None:
    encoder, config, _ = load_encoder(run / "last.pt")
    numbers = sum(p.numel() for p in encoder.parameters() if p.dim() > 1)
    assert exported.stat().st_size < 2.2 * numbers + 20_000 + 16 * config.spec.size
    assert max(parity(encoder, config, Encoder.open(exported, 1)).values()) > 0  # unrounded weights do differ


def test_predict_of_an_exported_run_undoes_a_shift(exported: Path) -> None:
    encoder = Encoder.open(exported, 1)
    view = np.zeros((64, 64, 4), np.uint8)
    view[20:40, 10:50] = [10, 200, 30, 255]
    points = predict(encoder, view, 500)
    assert points.shape == (500, 3)
    moved = np.roll(view, (5, 3), axis=(0, 1))
    assert predict(encoder, moved, 500) == pytest.approx(points)  # framing undoes a shift
