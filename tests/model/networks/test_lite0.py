"""The pretrained trunk: ImageNet's weights in our convolutions, trained, exported."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
import torch
import torch.nn.functional as nnf
from torch import nn

from model.config import TrainConfig
from model.data.dataset import Batch
from model.evaluation.references.features import _Pooled
from model.export import TOLERANCE, export
from model.networks.color_head import ColorHead, color_spec, look
from model.networks.encoder import ImageEncoder, _unshuffle
from model.networks.lite0 import FINE_MAPS, MAPS, MEAN, SPREAD, Lite0, load_imagenet
from model.training.checkpoints import load_network
from model.training.state import RunState
from model.training.train import batch_parts, train_step
from service.encoding.encoder import Encoder
from tests.support.small import network as small_network

pytestmark = pytest.mark.slow

ENCODER = replace(small_network.ENCODER, trunk="lite0", joined_maps=4)
CONFIG = replace(small_network.CONFIG, encoder=ENCODER, batch=4)


@pytest.fixture(scope="module")
def lite0() -> Lite0:
    network = Lite0(frozen=3)
    load_imagenet(network)
    return network.eval()


@torch.no_grad()
def test_lite0_gives_the_maps_of_the_published_network(lite0: Lite0) -> None:
    published, images = _Pooled().network.eval(), torch.rand(2, 3, 128, 128)
    x = published._swish(published._bn0(published._conv_stem((images - MEAN) / SPREAD)))
    widest = {}
    for block in published._blocks:
        x = block(x)
        widest[x.shape[-1]] = x
    fine, maps = lite0.look(images)
    assert (fine.shape, maps.shape) == ((2, FINE_MAPS, 8, 8), (2, MAPS, 4, 4))
    assert fine.numpy() == pytest.approx(widest[8].numpy(), abs=1e-3)
    assert maps.numpy() == pytest.approx(x.numpy(), abs=1e-3)
    assert torch.equal(lite0(images), maps)


def batch(config: TrainConfig) -> Batch:
    torch.manual_seed(0)
    shape = (config.batch, config.points, 3)
    return Batch(torch.rand(config.batch, 3, 32, 32), torch.rand(shape) - 0.5, torch.rand(shape) - 0.5, None)


def encoder_of(state: RunState) -> ImageEncoder:
    encoder = state.network.encoder
    assert isinstance(encoder, ImageEncoder)
    return encoder


def test_train_step_moves_weights_that_are_not_frozen_and_pretrained_ones_less(lite0: Lite0) -> None:
    state = RunState.begin(replace(CONFIG, weight_decay=0.0))
    with ThreadPoolExecutor(1) as threads:
        train_step(state, batch(CONFIG), 0.5, threads)
    now = state.network.get_submodule("encoder.features.lite0").state_dict()
    moved = {name: float((now[name] - was).abs().max()) for name, was in lite0.state_dict().items()}
    frozen = {name for name in moved if name.startswith(("stem.", "blocks.0.", "blocks.1.", "blocks.2."))}
    assert {name for name, much in moved.items() if much == 0} >= frozen
    assert {name for name, much in moved.items() if much > 0} == moved.keys() - frozen
    rate = CONFIG.learning_rate / 2  # at half of the budget, and Adam's first step is as long as that
    assert max(moved.values()) == pytest.approx(CONFIG.pretrained_rate * rate, rel=0.03)  # float32


def test_train_step_in_parts_gives_the_gradients_of_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("model.networks.encoder.DROPOUT", 0.0)
    monkeypatch.setattr("model.networks.precision.HALF", False)
    gradients, losses = [], []
    for count in (1, 3):  # 3 parts of 4 images: 2, 1 and 1
        state = RunState.begin(CONFIG)
        with ThreadPoolExecutor(count) as threads:
            losses.append(train_step(state, batch(CONFIG), 0.5, threads, parts=count))
        gradients.append(
            {name: weight.grad for name, weight in state.network.named_parameters() if weight.requires_grad}
        )
    assert losses[0] == pytest.approx(losses[1], rel=1e-5)
    for name, one in gradients[0].items():
        several = gradients[1][name]
        assert one is not None
        assert several is not None
        assert several.numpy() == pytest.approx(one.numpy(), abs=1e-4 * float(one.abs().max())), name


def test_batch_parts_of_a_normalized_network_is_one() -> None:
    assert batch_parts(RunState(small_network.CONFIG).network, small_network.CONFIG) == 1
    assert batch_parts(RunState(CONFIG).network, CONFIG) == min(os.cpu_count() or 1, CONFIG.batch)


def test_begin_with_another_trunk_takes_the_head(tmp_path: Path) -> None:
    dense = RunState.begin(small_network.CONFIG)
    nn.init.normal_(encoder_of(dense).head.linear.weight)
    dense.average.load_state_dict(dense.network.state_dict())
    dense.save(tmp_path, score=0)
    started = RunState.begin(replace(CONFIG, start=str(tmp_path / "last.pt")))
    assert torch.equal(encoder_of(started).head.linear.weight, encoder_of(dense).head.linear.weight)


def test_begin_with_finer_maps_starts_them_at_zero(tmp_path: Path) -> None:
    coarse = RunState.begin(CONFIG)
    coarse.save(tmp_path, score=0)
    finer = replace(CONFIG, encoder=replace(ENCODER, fine_maps=3), start=str(tmp_path / "last.pt"))
    state, images = RunState.begin(finer), torch.rand(2, 3, 32, 32)
    with torch.no_grad():
        assert torch.allclose(encoder_of(state).eval()(images), encoder_of(coarse).eval()(images), atol=1e-6)
    with ThreadPoolExecutor(1) as threads:
        for _ in range(2):  # at first only the weights that read them move
            train_step(state, batch(finer), 0.5, threads)
    assert not torch.equal(state.network.state_dict()["encoder.features.fine.weight"], fine_weights(finer))
    state.save(tmp_path, score=1)
    with pytest.raises(ValueError, match="another trunk"):
        RunState.begin(replace(CONFIG, spec=CONFIG.spec.with_k(1), start=str(tmp_path / "last.pt")))


def fine_weights(config: TrainConfig) -> torch.Tensor:
    """Return the weights that read the finer maps, as a run begins with them."""
    fine: torch.Tensor = RunState.begin(config).network.state_dict()["encoder.features.fine.weight"]
    return fine


def test_load_network_works_without_the_published_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    state = RunState.begin(CONFIG)
    state.save(tmp_path, score=0)
    monkeypatch.setattr("model.networks.lite0.load_imagenet", None)
    network, config, _ = load_network(tmp_path / "last.pt")
    assert config == CONFIG
    images, canonical = torch.rand(1, 3, 32, 32), torch.rand(1, 5, 3)
    points, expected = network(images, canonical).detach(), state.average(images, canonical).detach()
    assert points.numpy() == pytest.approx(expected.numpy(), abs=1e-6)


@pytest.mark.parametrize("fine_maps", [0, 3])
def test_export_of_lite0_agrees_with_torch(fine_maps: int, tmp_path: Path) -> None:
    config, path = replace(CONFIG, encoder=replace(ENCODER, fine_maps=fine_maps)), tmp_path / "lite0.onnx"
    encoder = encoder_of(RunState.begin(config)).eval()
    head = ColorHead(color_spec(config.spec), look(encoder, torch.zeros(1, 3, 32, 32))[1].shape[1]).eval()
    for color in (None, head):
        assert max(export(encoder, config, {"name": "lite0"}, path, color).values()) < TOLERANCE
        assert Encoder.open(path, threads=1).framing == config.framing


def test_unshuffle_is_that_of_torch() -> None:
    maps = torch.rand(2, 3, 8, 6)
    assert torch.equal(_unshuffle(maps, 3), nnf.pixel_unshuffle(maps, 2))
