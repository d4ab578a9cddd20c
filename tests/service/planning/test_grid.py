"""The occupancy grid: free cells, clearance, lines of sight."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.planning.grid import Grid

COORDINATE = st.floats(-1, 1, width=32)
POINT = st.tuples(COORDINATE, COORDINATE, COORDINATE)


def _grid(*points: tuple[float, float, float], cells: int = 8, clearance: float = 0.0) -> Grid:
    return Grid.of(np.array(points, np.float32).reshape(-1, 3), cells, clearance)


def test_grid_of_one_point_blocks_its_cell() -> None:
    grid = _grid((0.1, -0.1, 0.99))
    assert np.argwhere(~grid.free).tolist() == [[4, 3, 7]]
    assert not grid.is_free((0.2, -0.01, 0.8))


def test_grid_at_its_far_sides_uses_the_last_cells() -> None:
    assert _grid((1, 1, -1)).cell((1, 1, -1)) == (7, 7, 0)
    assert np.argwhere(~_grid((1, 1, -1)).free).tolist() == [[7, 7, 0]]


def test_grid_of_points_outside_the_cube_is_free() -> None:
    assert _grid((1.01, 0, 0), (np.nan, 0, 0)).free.all()


@pytest.mark.parametrize(("clearance", "count"), [(0, 1), (0.01, 27), (0.25, 27), (0.26, 27 + 6 * 9), (9, 512)])
def test_grid_with_clearance_blocks_cells_nearer_than_it(clearance: float, count: int) -> None:
    assert int((~_grid((0.01, 0.01, 0.01), clearance=clearance).free).sum()) == count


@given(st.lists(POINT, min_size=1, max_size=5), st.floats(0, 0.8), st.sampled_from([8, 11]))
@settings(deadline=None)
def test_grid_with_clearance_keeps_every_free_cell_that_far_from_the_points(
    points: list[tuple[float, float, float]], clearance: float, cells: int
) -> None:
    grid = _grid(*points, cells=cells, clearance=clearance)
    half = 1 / cells
    gaps = np.abs(grid.centers(np.argwhere(grid.free))[:, None] - np.array(points)).clip(half) - half
    distances = np.linalg.norm(gaps, axis=2)  # from the nearest place in a free cell
    assert not distances.size or distances.min() >= clearance - 1e-5


def test_sees_along_a_line_of_free_cells_only() -> None:
    grid = _grid((0.1, 0.1, 0.1))
    start, end = np.array([-0.9, 0.1, 0.1]), np.array([0.9, 0.1, 0.1])
    assert not grid.sees(start, end)
    assert not grid.sees(end, start)
    assert grid.sees(start, np.array([-0.1, 0.1, 0.1]))
    assert grid.sees(np.array([-0.9, 0.4, 0.1]), np.array([0.9, 0.4, 0.1]))
    assert grid.sees(start, start)


def test_sees_across_a_corner_or_along_a_side_of_a_blocked_cell_is_false() -> None:
    grid = _grid((0.1, 0.1, 0.1))  # the cell from 0 to 0.25
    assert not grid.sees(np.array([-0.25, 0.25, 0.1]), np.array([0.25, -0.25, 0.1]))  # through the edge at 0, 0
    assert not grid.sees(np.array([-0.9, 0.0, 0.1]), np.array([0.9, 0.0, 0.1]))  # along its side


@given(st.lists(POINT, max_size=40), POINT, POINT)
@settings(deadline=None)
def test_sees_equals_free_cells_at_many_places_of_the_segment(
    points: list[tuple[float, float, float]], start: tuple[float, float, float], end: tuple[float, float, float]
) -> None:
    grid = _grid(*points)
    if grid.sees(np.array(start), np.array(end)):
        for share in np.linspace(0, 1, 200)[:, None]:
            (place,) = np.array([start]) + share * (np.array([end]) - np.array([start]))
            assert grid.is_free(place.tolist())
