"""Surfaces cut where the mapping function tears them."""

import numpy as np
import numpy.typing as npt
import pytest

from service.mapping.spec import Array
from service.mapping.surface import icosphere
from service.mapping.tears import Indices, stretches, without_tears

GAP = 0.4


def pulled_apart(points: Array) -> Array:
    """Move both halves of a sphere away from each other along x, as a function with a steep step does."""
    images = points.copy()
    images[:, 0] += np.clip(points[:, 0] / 0.02, -1, 1) * GAP
    return images


@pytest.fixture
def sphere() -> tuple[Array, Indices]:
    return icosphere(24)


def lengths(vertices: Array, triangles: Indices) -> npt.NDArray[np.float32]:
    corners = vertices[triangles]
    edges: npt.NDArray[np.float32] = np.linalg.norm(corners - corners[:, [1, 2, 0]], axis=2)
    return edges


def edge_uses(triangles: Indices) -> npt.NDArray[np.intp]:
    """Return how many triangles use each edge."""
    edges = np.sort(np.concatenate([triangles[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def test_without_tears_of_a_torn_sphere_leaves_two_clean_halves(sphere: tuple[Array, Indices]) -> None:
    points, triangles = sphere
    fresh, kept = without_tears(points, pulled_apart(points), triangles)
    vertices = pulled_apart(np.concatenate([points, fresh]))
    sides = np.sign(vertices[kept][:, :, 0])
    assert (sides == sides[:, :1]).all()  # no triangle spans the gap
    assert lengths(vertices, kept).max() < GAP / 2
    assert set(edge_uses(kept)) == {1, 2}  # a border, and no edge of three triangles
    a, b, c = vertices[kept].transpose(1, 0, 2)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 0


def test_without_tears_cuts_along_a_smoother_line_than_triangles_do(sphere: tuple[Array, Indices]) -> None:
    points, triangles = sphere
    fresh, _ = without_tears(points, pulled_apart(points), triangles)
    cut = fresh[fresh[:, 0] > 0]
    is_whole = (points[triangles][:, :, 0] > fresh[:, 0].max()).all(axis=1)
    teeth = points[np.intersect1d(triangles[is_whole], triangles[~is_whole])]  # the border, had none been split
    assert cut[:, 0].std() < teeth[:, 0].std() / 2


def test_without_tears_of_an_even_sphere_keeps_every_triangle(sphere: tuple[Array, Indices]) -> None:
    points, triangles = sphere
    fresh, kept = without_tears(points, 3 * points, triangles)
    assert fresh.shape == (0, 3)
    np.testing.assert_array_equal(kept, triangles)


def test_without_tears_of_a_point_keeps_every_triangle(sphere: tuple[Array, Indices]) -> None:
    points, triangles = sphere
    assert (stretches(points, np.zeros_like(points), triangles) == 0).all()
    assert len(without_tears(points, np.zeros_like(points), triangles)[1]) == len(triangles)


def test_without_tears_keeps_triangles_facing_outward(sphere: tuple[Array, Indices]) -> None:
    points, triangles = sphere
    fresh, kept = without_tears(points, pulled_apart(points), triangles)
    a, b, c = np.concatenate([points, fresh])[kept].transpose(1, 0, 2)
    assert (np.einsum("td,td->t", np.cross(b - a, c - a), a) > 0).all()
