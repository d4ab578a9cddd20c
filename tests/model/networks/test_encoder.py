"""The encoder's size and start, and f^k in torch against NumPy."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from model.config import EncoderConfig, Predicted
from model.networks.encoder import HEAD_SCALE, ImageEncoder, predicted_mask
from model.networks.mapping import power
from model.networks.resnet18 import ResNetMaps
from service import mapping
from service.mapping.canonical import canonical_points
from service.mapping.spec import HOF_1, HOF_3, MappingSpec

SPECS = [
    HOF_1,
    HOF_1.with_k(2),
    HOF_3.with_k(4),
    MappingSpec("deep", 3, (32,) * 6, 3, "tanh", 2, "cube"),
    MappingSpec("sphere", 3, (64, 16), 3, "relu", 1, "sphere"),
    MappingSpec("four", 4, (64,), 3, "relu", 1, "ball4"),
]


def test_resnet18_has_its_parameters_and_halves_the_side_five_times() -> None:
    maps = ResNetMaps()
    assert sum(parameter.numel() for parameter in maps.parameters()) == 11_176_512
    assert maps.eval()(torch.rand(1, 3, 64, 64)).shape == (1, 512, 2, 2)
    config = EncoderConfig(trunk="resnet18", fully_connected=(16,), rank=0)
    assert ImageEncoder(HOF_1, config, 64)(torch.rand(2, 3, 64, 64)).shape == (2, 7_171)


@pytest.mark.parametrize(
    ("predicted", "count"), [("first_bias", 16), ("biases", 16 + 3), ("first_layer", 4 * 16), ("all", 4 * 16 + 17 * 3)]
)
def test_theta_outside_the_predicted_part_is_the_same_for_all_images(predicted: Predicted, count: int) -> None:
    spec = MappingSpec("small", 3, (16,), 3)
    assert predicted_mask(spec, predicted).sum() == count
    encoder = ImageEncoder(spec, EncoderConfig((4, 4, 4), 1, (8,), 0, predicted=predicted), 32)
    thetas = encoder(torch.rand(2, 3, 32, 32))
    differs = (thetas[0] != thetas[1]).numpy()
    assert differs.sum() == count
    assert (differs == predicted_mask(spec, predicted)).all()
    thetas.sum().backward()
    assert encoder.head.linear.bias.grad.all()  # type: ignore[union-attr]


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: f"{spec.name}-k{spec.k}")
def test_power_equals_the_numpy_reference(spec: MappingSpec) -> None:
    thetas = np.stack([mapping.initial_theta(spec, seed) for seed in (0, 1, 2)])
    x = canonical_points(spec.domain, 300, seed=1)
    points = power(spec, torch.from_numpy(thetas), torch.from_numpy(x).expand(3, -1, -1)).numpy()
    for theta, cloud in zip(thetas, points, strict=True):
        assert cloud == pytest.approx(mapping.power(spec, theta, x), abs=1e-5)


@pytest.mark.parametrize("spec", [HOF_1.with_k(2), MappingSpec("tanh", 3, (8,), 3, "tanh", 3)])
def test_power_has_the_right_gradients(spec: MappingSpec) -> None:
    small = replace(spec, hidden=(6,))
    theta = torch.from_numpy(mapping.initial_theta(small)).double().unsqueeze(0).requires_grad_()
    x = torch.from_numpy(canonical_points(small.domain, 7)).double().unsqueeze(0)
    assert torch.autograd.gradcheck(lambda t: power(small, t, x), (theta,))


def test_encoder_of_full_rank_is_a_50_megabyte_file() -> None:
    encoder = ImageEncoder(HOF_1, EncoderConfig(rank=0), 64)
    numbers = sum(parameter.numel() for parameter in encoder.parameters())
    assert 45e6 < 4 * numbers < 55e6
    assert encoder(torch.zeros(2, 3, 64, 64)).shape == (2, 7171)


def test_encoder_starts_every_object_near_theta_0() -> None:
    torch.manual_seed(0)
    encoder = ImageEncoder(HOF_1, EncoderConfig(), 64)
    thetas = encoder(torch.rand(8, 3, 64, 64)).detach()
    offsets = (thetas - encoder.head.theta_0) / encoder.head.scale
    assert float(offsets.std()) == pytest.approx(HEAD_SCALE, rel=0.2)
    assert float(thetas.std(dim=0).max()) > 0  # objects differ: exactly zero weights would stall
