"""The torch side: encoder sizes, f^k against NumPy, losses, metrics, batches."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import torch

from model.config import EncoderConfig, TrainConfig
from model.data.dataset import Examples, augment, draw_batch, plain_images
from model.data.manifest import Entry
from model.losses import chamfer, nearest, projection
from model.metrics import compare, interval
from model.networks import HEAD_SCALE, ImageEncoder, power
from service import mapping
from service.canonical import canonical_points
from service.mapping import HOF_1, HOF_3, MappingSpec

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


def test_chamfer_is_the_sum_of_both_squared_directions() -> None:
    rng = np.random.default_rng(0)
    a, b = (torch.from_numpy(rng.random((2, n, 3), np.float32)) for n in (40, 60))
    squared = torch.cdist(a, b).square()
    with ThreadPoolExecutor(2) as threads:
        assert (nearest(a, b, threads) == squared.argmin(2)).all()
        assert float(chamfer(a, b, threads)) == pytest.approx(
            float(squared.amin(2).mean() + squared.amin(1).mean()), rel=1e-5
        )


def test_chamfer_pulls_points_to_their_neighbours() -> None:
    predicted = torch.tensor([[[0.0, 0, 0]]], requires_grad=True)
    with ThreadPoolExecutor(1) as threads:
        chamfer(predicted, torch.tensor([[[1.0, 0, 0]]]), threads).backward()  # type: ignore[no-untyped-call]
    assert predicted.grad is not None
    assert predicted.grad.tolist() == [[[-4, 0, 0]]]  # d/dx 2 (x - 1)^2 at 0


def test_projection_is_the_mean_squared_way() -> None:
    there, here = torch.ones(2, 5, 3), torch.zeros(2, 5, 3)
    assert float(projection(there, here)) == 3


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


@pytest.fixture
def examples() -> Examples:
    rng = np.random.default_rng(0)
    crops = np.zeros((10, 4, 32, 32, 4), np.uint8)
    crops[:, :, 8:24, 8:24] = [200, 30, 30, 255]
    crops[..., 0] = np.where(crops[..., 3] > 0, np.arange(10)[:, None, None, None] * 20, 0)
    entries = [Entry(str(i), "n", "s", "c", "x", "CC0", "h", "f", "train") for i in range(10)]
    return Examples(entries, crops, rng.random((10, 500, 3), np.float32))


TINY = TrainConfig(batch=4, points=16, target_points=20)


def test_a_batch_depends_on_seed_and_step_alone(examples: Examples) -> None:
    first, again = draw_batch(examples, TINY, 7), draw_batch(examples, TINY, 7)
    assert (first.images == again.images).all()
    assert (first.canonical == again.canonical).all()
    assert (first.points == again.points).all()
    for other in (draw_batch(examples, TINY, 8), draw_batch(examples, replace(TINY, seed=1), 7)):
        assert (first.images != other.images).any()
        assert (first.canonical != other.canonical).any()


def test_every_object_comes_once_per_epoch(examples: Examples) -> None:
    owners = []
    for step in range(5):  # 5 steps of 4: two epochs of 10
        batch = draw_batch(examples, TINY, step)
        owners += [int(np.abs(examples.points - p[0].numpy()).sum(2).min(1).argmin()) for p in batch.points]
    assert sorted(owners) == sorted([*range(10), *range(10)])


def test_images_and_points_of_a_batch_are_of_the_same_object(examples: Examples) -> None:
    plain = [float(plain_images(examples.crops[i, :1])[0, 1, 8, 8]) for i in range(10)]
    assert len(set(plain)) == 1  # green is the same for all: only red tells
    batch = draw_batch(examples, replace(TINY, batch=10), 0)
    for image, points in zip(batch.images, batch.points, strict=True):
        owner = int(np.abs(examples.points - points[0].numpy()).sum(2).min(1).argmin())
        ratio = float(image[0, 8, 8] / image[1, 8, 8])  # light changes both, the tint by up to 12%
        grey = float(image.std(dim=0)[8, 8]) < 1e-3
        assert grey or ratio == pytest.approx(owner * 20 / 30, rel=0.3, abs=0.05)


def test_augmentation_keeps_the_range_and_mixes_backgrounds(examples: Examples) -> None:
    crops = torch.from_numpy(examples.crops[:, 0]).permute(0, 3, 1, 2).float() / 255
    images = augment(torch.cat([crops] * 10), np.random.default_rng(0))
    assert images.shape == (100, 3, 16, 16)
    assert float(images.min()) >= 0
    assert float(images.max()) <= 1
    white = (images[:, :, 0, 0] == 1).all(dim=1).float().mean()
    assert 0.3 < float(white) < 0.7


def test_config_survives_its_checkpoint_form() -> None:
    config = TrainConfig(spec=SPECS[3], encoder=EncoderConfig((4, 5), 2, (8,), 0), seed=5, projection=0.01)
    assert TrainConfig.from_dict(config.to_dict()) == config
