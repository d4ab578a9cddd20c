"""Encoders of points, PointNet and a grid: neither the order of points nor their repetition matters."""

import pytest
import torch
from torch import Tensor

from model.config import EncoderConfig
from model.networks.encoder import ImageEncoder
from service.mapping.spec import MappingSpec

POINTNET = EncoderConfig(trunk="pointnet", point_maps=(8, 16, 16, 32), fully_connected=(32,), rank=8)
GRID = EncoderConfig(trunk="grid", feature_maps=(8, 8), convolutions=2, fully_connected=(32,), rank=8)
SPEC = MappingSpec("small", 3, (32,), 3, k=2)


@pytest.fixture(scope="module", params=(POINTNET, GRID), ids=lambda config: config.trunk)
def encoder(request: pytest.FixtureRequest) -> ImageEncoder:
    torch.manual_seed(0)
    return ImageEncoder(SPEC, request.param, 64).eval()


@pytest.fixture(scope="module")
def points() -> Tensor:
    return torch.rand(2, 100, 3, generator=torch.Generator().manual_seed(1)) - 0.5


def test_encoder_of_points_gives_a_theta_for_each_cloud(encoder: ImageEncoder, points: Tensor) -> None:
    theta = encoder(points)
    assert theta.shape == (2, SPEC.size)
    assert not torch.allclose(theta[0], theta[1], atol=1e-5)


def test_encoder_of_points_ignores_their_order_and_repetition(encoder: ImageEncoder, points: Tensor) -> None:
    order = torch.randperm(100, generator=torch.Generator().manual_seed(2))
    torch.testing.assert_close(encoder(points[:, order]), encoder(points))
    torch.testing.assert_close(encoder(torch.cat([points, points[:, :30]], dim=1)), encoder(points))


def test_encoder_of_points_reads_every_coordinate(encoder: ImageEncoder, points: Tensor) -> None:
    for axis in range(3):
        moved = points.clone()
        moved[..., axis] *= 0.5
        assert not torch.allclose(encoder(moved), encoder(points), atol=1e-5)  # an untrained grid says little
