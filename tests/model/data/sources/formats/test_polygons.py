"""Polygons divided into triangles: they cover the polygon, once."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from model.data.sources.formats.polygons import concave, split_polygon

KEYHOLE = [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)]  # a square with a hole


def area(polygon: np.ndarray) -> float:
    """Return the signed area of a polygon in the plane, (k, 2)."""
    x, y = polygon.T
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2)


def solid(polygon: np.ndarray) -> np.ndarray:
    """Put a polygon of the plane, (k, 2), into space, (k, 3), on a slope."""
    x, y = polygon.T
    return np.stack([x, y, 0.3 * x - 0.2 * y], axis=1)


@given(st.lists(st.floats(0.2, 1), min_size=4, max_size=24), st.booleans())
def test_split_polygon_star_is_covered_once(radii: list[float], reverse: bool) -> None:
    angles = np.linspace(0, 2 * np.pi, len(radii), endpoint=False)
    star = np.stack([np.cos(angles), np.sin(angles)], axis=1) * np.array(radii)[:, None]
    star = star[::-1] if reverse else star
    triangles = split_polygon(solid(star))
    assert len(triangles) == len(star) - 2
    areas = np.array([area(star[list(corners)]) for corners in triangles])
    assert (np.sign(area(star)) * areas >= -1e-9).all()
    assert areas.sum() == pytest.approx(area(star))


def test_split_polygon_keyhole_leaves_the_hole_free() -> None:
    polygon = np.array(KEYHOLE, float)
    areas = [area(polygon[list(corners)]) for corners in split_polygon(solid(polygon))]
    assert sum(areas) == pytest.approx(12)
    assert min(areas) >= -1e-9


def test_split_polygon_without_area_is_a_fan() -> None:
    assert split_polygon(np.ones((4, 3))) == [(0, 1, 2), (0, 2, 3)]


def test_concave_square_arrow_and_bent_quad_only_arrow_is() -> None:
    square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    arrow = [(0, 0, 0), (1, 0, 0), (0.2, 0.2, 0), (0, 1, 0)]
    bent = [(0, 0, 0), (1, 0, 0.3), (1, 1, 0), (0, 1, 0.3)]
    assert concave(np.array([square, arrow, bent])).tolist() == [False, True, False]
