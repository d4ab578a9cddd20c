"""Partial surfaces: what is kept, in which frame, and how it is drawn."""

import numpy as np
import pytest
import torch
from torch import Tensor

from model.data.rendering.partial import (
    SURFACE,
    Parts,
    draw_counts,
    draw_parts,
    fixed_parts,
    on_one_side,
    seen_from,
    turned,
)
from service.encoding.clouds import LEAST_POINTS, MOST_POINTS, normalize
from tests.support.small.data import box

B = 6


@pytest.fixture(scope="module")
def surface() -> Tensor:
    return torch.stack([torch.from_numpy(box(number))[:SURFACE] for number in range(B)])


@pytest.fixture(scope="module")
def parts(surface: Tensor) -> Parts:
    generator = torch.Generator().manual_seed(0)
    return draw_parts(surface, torch.full((B,), 100), 512, generator)


def test_draw_parts_gives_each_part_in_its_own_box(parts: Parts) -> None:
    assert parts.clouds.shape == (B, 512, 3)
    low, high = parts.clouds.amin(1), parts.clouds.amax(1)
    torch.testing.assert_close(low, -high, atol=1e-5, rtol=0)
    torch.testing.assert_close((high - low).amax(1), torch.ones(B))


def test_draw_parts_lie_on_the_surface_up_to_the_noise(surface: Tensor, parts: Parts) -> None:
    back = parts.clouds * parts.scale + parts.center
    assert torch.cdist(back, surface).amin(2).mean() < 0.03
    assert (parts.scale <= 1.15).all()


def test_draw_parts_repeats_the_points_of_a_part_with_few(parts: Parts) -> None:
    torch.testing.assert_close(parts.clouds[:, 100:], parts.clouds[:, :412])
    assert len(np.unique(parts.clouds[0].numpy(), axis=0)) == 100


def test_draw_parts_of_the_same_generator_is_the_same(surface: Tensor) -> None:
    assert torch.equal(fixed_parts(surface, 3).clouds, fixed_parts(surface, 3).clouds)
    assert not torch.equal(fixed_parts(surface, 3).clouds, fixed_parts(surface, 4).clouds)


@pytest.mark.parametrize("share", [0.25, 0.7, 1.0])
def test_on_one_side_keeps_the_share_beyond_a_plane(surface: Tensor, share: float) -> None:
    toward = torch.tensor([[0.3, -1.0, 2.0]]).expand(B, -1)
    kept = on_one_side(surface, toward, torch.full((B, 1), share))
    assert kept.sum(1).tolist() == [int(np.ceil(share * SURFACE))] * B
    heights = surface @ toward[0]
    for height, mask in zip(heights, kept, strict=True):
        if not mask.all():
            assert height[mask].min() >= height[~mask].max()


def test_seen_from_keeps_the_faces_that_a_camera_sees() -> None:
    points = torch.from_numpy(box(0))[None, :SURFACE]
    half = points.abs().amax(1)[0]
    front, back = (torch.isclose(points[0, :, 2], sign * half[2], atol=1e-4) for sign in (1, -1))
    mask = seen_from(points, torch.tensor([[0.0, 0.0, 1.0]]))[0]
    assert mask[front].float().mean() > 0.99
    assert not mask[back].any()


def test_draw_counts_spans_the_limits_of_the_encoder() -> None:
    counts = draw_counts(5_000, MOST_POINTS, torch.device("cpu"), torch.Generator().manual_seed(0))
    assert LEAST_POINTS <= counts.min() < 70
    assert 1_950 < counts.max() <= MOST_POINTS
    assert 300 < counts.double().median() < 430  # the middle of the logarithms


def test_turned_by_a_quarter_moves_the_front_to_the_right() -> None:
    front = torch.tensor([[[0.0, 0.5, 1.0]]])
    torch.testing.assert_close(turned(front, torch.tensor([90.0])), torch.tensor([[[1.0, 0.5, 0.0]]]))


def test_normalize_of_the_service_is_the_frame_of_training(surface: Tensor) -> None:
    parts = fixed_parts(surface, 0)
    cloud = (parts.clouds[0] * parts.scale[0] + parts.center[0]).numpy()
    result = normalize(cloud, len(cloud))
    away = torch.cdist(torch.from_numpy(result.tensor[0]), parts.clouds[0])
    assert max(away.amin(0).max(), away.amin(1).max()) < 1e-3  # in another order
    assert result.scale == pytest.approx(float(parts.scale[0]), rel=1e-5)
