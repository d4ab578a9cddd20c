"""Heads for the confidence and the camera: pooling, the azimuth of a distribution, shapes."""

import numpy as np
import pytest
import torch

from model.networks.estimate_heads import BINS, EstimateHeads, direction, pool


def _bins(*places: tuple[float, float]) -> torch.Tensor:
    """Return one distribution with narrow hills at azimuths (degrees) of given weights."""
    centers = np.arange(BINS) * 360 / BINS
    hills = sum(weight * np.exp(20 * (np.cos(np.radians(at - centers)) - 1)) for at, weight in places)
    return torch.from_numpy(np.asarray(hills / np.sum(hills), np.float32))[None]


@pytest.mark.parametrize("azimuth", [0.0, 4.0, 90.0, 137.0, -179.0, -90.0, -2.5])
def test_direction_of_a_hill_is_its_top(azimuth: float) -> None:
    assert direction(_bins((azimuth, 1))).item() == pytest.approx(azimuth, abs=1)


def test_direction_of_two_opposite_hills_is_the_higher_one() -> None:
    assert direction(_bins((20, 0.55), (200, 0.45))).item() == pytest.approx(20, abs=2)


def test_pooled_of_maps_is_their_mean_and_largest_value() -> None:
    maps = torch.arange(24.0).reshape(2, 3, 2, 2)
    result = pool([torch.ones(2, 5), maps])
    assert result.shape == (2, 11)
    assert result[1].tolist() == [1, 1, 1, 1, 1, 13.5, 17.5, 21.5, 15, 19, 23]


def test_heads_of_any_tensors_give_a_confidence_and_a_camera() -> None:
    heads = EstimateHeads({"code": (6,), "maps": (8,), "last": (3, 2, 2)}, members=3).eval()
    confidence, camera = heads(torch.randn(4, 6), torch.randn(4, 8), torch.randn(4, 3, 2, 2))
    assert (confidence.shape, camera.shape) == ((4, 1), (4, 4))
    assert ((confidence > 0) & (confidence < 1)).all()
    assert (camera[:, 2] > 0).all()


def test_confidence_does_not_read_the_flat_maps() -> None:
    heads = EstimateHeads({"code": (6,), "maps": (8,)}, members=2).eval()
    code = torch.randn(1, 6)
    one, other = (heads(code, torch.randn(1, 8)) for _ in range(2))
    assert torch.equal(one[0], other[0])
    assert not torch.equal(one[1], other[1])
