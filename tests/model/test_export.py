"""Encoders of any kind as ONNX files: torch and the service agree."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model.cli.common import SHIPPED
from model.export import TOLERANCE, export
from model.networks.encoder import ImageEncoder
from model.training.checkpoints import load_encoder
from service.encoding.encoder import Encoder
from service.mapping.spec import MappingSpec
from tests.support.small import network as small_network


@pytest.mark.parametrize("name", ["hof1-k2", "hof1-k4", "hof1-k2-points"])
def test_load_encoder_of_shipped_weights_agrees_with_the_service(name: str) -> None:
    file = SHIPPED.parent / f"{name}.onnx"
    served, (encoder, config, _) = Encoder.open(file, threads=1), load_encoder(file)
    inputs = np.random.default_rng(0).random((2, *served.input_shape), np.float32)
    if config.encoder.takes_points:
        inputs -= np.float32(0.5)
    theta = np.stack([functions.theta for functions in served.encode(inputs)])
    np.testing.assert_allclose(encoder(torch.from_numpy(inputs)).detach().numpy(), theta, atol=TOLERANCE)


@pytest.mark.parametrize(
    "spec",
    [
        MappingSpec("hof3", 3, (16, 16, 16), 3, k=1),
        MappingSpec("tanh", 3, (16,), 3, "tanh", 4, "cube"),
        MappingSpec("four", 4, (16,), 3, k=1, domain="ball4"),
    ],
    ids=lambda spec: spec.name,
)
@pytest.mark.parametrize("rank", [0, 8])
def test_export_of_every_configuration_has_parity(spec: MappingSpec, rank: int, tmp_path: Path) -> None:
    config = replace(small_network.CONFIG, spec=spec, encoder=replace(small_network.CONFIG.encoder, rank=rank))
    encoder = ImageEncoder(spec, config.encoder, config.framing.size).eval()
    differences = export(encoder, config, {"name": "x"}, tmp_path / "x.onnx")
    assert max(differences.values()) < TOLERANCE
    assert Encoder.open(tmp_path / "x.onnx", 1).spec == spec


def test_export_of_a_file_that_disagrees_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from model import export as module

    config = small_network.CONFIG
    encoder = ImageEncoder(config.spec, config.encoder, config.framing.size).eval()
    monkeypatch.setattr(module, "TOLERANCE", 0.0)
    with pytest.raises(ValueError, match="disagree"):
        export(encoder, config, {"name": "x"}, tmp_path / "x.onnx")
    assert not list(tmp_path.iterdir())
