"""Points of a shape that are visible from outside."""

import numpy as np
import pytest
import trimesh

from model.data.manifest import SURFACE_POINTS
from model.data.procedural import pieces
from model.data.rendering.surface import Floats, sample_surface
from model.data.rendering.visible import visible


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


def sampled(*parts: trimesh.Trimesh) -> Floats:
    return sample_surface(list(parts), 40_000, np.random.default_rng(0))[0]


def test_visible_box_in_a_box_is_hidden() -> None:
    outer, inner = (box((-half,) * 3, (half,) * 3) for half in (0.5, 0.3))
    both = sampled(outer, inner)
    within = np.abs(both).max(axis=1) < 0.4
    assert 0.2 < within.mean() < 0.3
    np.testing.assert_array_equal(visible(both, both), ~within)
    alone = sampled(inner)
    assert visible(alone, alone).all()


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("side", [-1, 1])
def test_visible_inside_of_an_open_box_is_visible(axis: int, side: int) -> None:
    closed = box((-0.5,) * 3, (0.5,) * 3)
    open_ = closed.copy()
    open_.update_faces(closed.face_normals[:, axis] * side < 0.5)
    inner = sampled(box((-0.2,) * 3, (0.2,) * 3))
    for shell, share in ((closed, 0), (open_, 1)):
        mask = visible(inner, np.concatenate([sampled(shell), inner]))
        toward = np.isclose(inner[:, axis], 0.2 * side)
        away = np.isclose(inner[:, axis], -0.2 * side)
        assert (mask[toward].mean(), mask[away].mean()) == (share, 0)


def test_visible_thin_plate_is_visible_from_both_sides() -> None:
    plate = sampled(box((-0.5, -0.002, -0.3), (0.5, 0.002, 0.3)))
    assert visible(plate, plate).all()


def test_visible_points_overlapping_solids_lie_outside_both() -> None:
    """A cushion that reaches into its base: no point inside either."""
    parts = [box((-0.5, -0.3, -0.5), (0.5, 0.1, 0.5)), box((-0.4, -0.1, -0.4), (0.4, 0.3, 0.4))]
    points = pieces.visible_points(parts, np.random.default_rng(0))
    assert points.shape == (SURFACE_POINTS, 3)
    x, y, z = np.abs(points[:, 0]), points[:, 1], np.abs(points[:, 2])
    assert not ((x < 0.36) & (z < 0.36) & (y > -0.26) & (y < 0.26)).any()
    base_top = np.isclose(y, 0.1, atol=1e-6) & ((x > 0.4) | (z > 0.4))
    assert base_top.mean() == pytest.approx(0.36 / (2 * 1 + 4 * 0.4 + 4 * 0.8 * 0.2), rel=0.1)  # as its area
