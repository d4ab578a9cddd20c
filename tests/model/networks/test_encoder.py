"""The torch side: encoder sizes, f^k against NumPy, metrics, configurations."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from model.config import EncoderConfig, TrainConfig
from model.metrics import compare, interval
from model.networks.encoder import HEAD_SCALE, ImageEncoder
from model.networks.mapping import power
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


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: f"{spec.name}-k{spec.k}")
def test_power_is_the_numpy_reference(spec: MappingSpec) -> None:
    thetas = np.stack([mapping.initial_theta(spec, seed) for seed in (0, 1, 2)])
    x = canonical_points(spec.domain, 300, seed=1)
    points = power(spec, torch.from_numpy(thetas), torch.from_numpy(x).expand(3, -1, -1)).numpy()
    for theta, found in zip(thetas, points, strict=True):
        assert found == pytest.approx(mapping.power(spec, theta, x), abs=1e-5)


@pytest.mark.parametrize("spec", [HOF_1.with_k(2), MappingSpec("tanh", 3, (8,), 3, "tanh", 3)])
def test_power_has_the_right_gradients(spec: MappingSpec) -> None:
    small = replace(spec, hidden=(6,))
    theta = torch.from_numpy(mapping.initial_theta(small)).double().unsqueeze(0).requires_grad_()
    x = torch.from_numpy(canonical_points(small.domain, 7)).double().unsqueeze(0)
    assert torch.autograd.gradcheck(lambda t: power(small, t, x), (theta,))


def test_the_paper_encoder_is_a_50_megabyte_file() -> None:
    encoder = ImageEncoder(HOF_1, EncoderConfig(rank=0), 64)
    numbers = sum(parameter.numel() for parameter in encoder.parameters())
    assert 45e6 < 4 * numbers < 55e6
    assert encoder(torch.zeros(2, 3, 64, 64)).shape == (2, 7171)


def test_every_object_starts_near_the_same_sane_function() -> None:
    torch.manual_seed(0)
    encoder = ImageEncoder(HOF_1, EncoderConfig(), 64)
    thetas = encoder(torch.rand(8, 3, 64, 64)).detach()
    away = (thetas - encoder.head.theta_0) / encoder.head.scale
    assert float(away.std()) == pytest.approx(HEAD_SCALE, rel=0.2)
    assert float(thetas.std(dim=0).max()) > 0  # objects differ: exactly zero weights would stall


def test_metrics_of_two_known_clouds() -> None:
    predicted = np.array([[0, 0, 0], [1, 0, 0]], np.float32)
    true = np.array([[0, 0, 0.015], [1, 0, 0], [1, 0, 0.5]], np.float32)
    found = compare(predicted, true)
    assert found["cd_forward"] == pytest.approx(100 * 0.015 / 2)
    assert found["cd_backward"] == pytest.approx(100 * 0.515 / 3)
    assert found["cd_sq"] == pytest.approx(100 * (0.015**2 / 2 + (0.015**2 + 0.25) / 3))
    assert found["f@1%"] == pytest.approx(2 * 0.5 * (1 / 3) / (0.5 + 1 / 3))
    assert found["f@2%"] == pytest.approx(2 * 1 * (2 / 3) / (1 + 2 / 3))
    assert compare(predicted, predicted + 9)["f@5%"] == 0


def test_the_interval_covers_the_mean_and_narrows_with_objects() -> None:
    rng = np.random.default_rng(0)
    values = rng.normal(3, 1, 400)
    mean, low, high = interval(values)
    assert mean == pytest.approx(values.mean())
    assert high - low == pytest.approx(2 * 1.96 / 20, rel=0.1)
    few_low, few_high = interval(values[:25])[1:]
    assert few_high - few_low > 2 * (high - low)


def test_config_survives_its_checkpoint_form() -> None:
    config = TrainConfig(spec=SPECS[3], encoder=EncoderConfig((4, 5), 2, (8,), 0), seed=5, projection=0.01)
    assert TrainConfig.from_dict(config.to_dict()) == config
