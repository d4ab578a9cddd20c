"""Paths around a ball, whose shortest paths are known, and their clearance."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.mapping.canonical import canonical_points
from service.mapping.spec import Array
from service.planning.grid import Floats, Grid
from service.planning.path import Path, plan, points_for

RADIUS = 0.5


def _ball(cells: int) -> Array:
    return np.float32(RADIUS) * canonical_points("sphere", points_for(cells), sampling="sobol")


def _distance(path: Floats, points: Array) -> float:
    """Return the smallest distance of a polyline from points."""
    distances = []
    for start, end in itertools.pairwise(path):
        along = end - start
        share = ((points - start) @ along / max(along @ along, 1e-12)).clip(0, 1)
        distances.append(np.linalg.norm(points - start - share[:, None] * along, axis=1).min())
    return float(min(distances))


def _around(distance: float, radius: float) -> float:
    """Return the length of the shortest path around a ball between opposite points, `distance` from its center."""
    return float(2 * np.sqrt(distance**2 - radius**2) + radius * (np.pi - 2 * np.arccos(radius / distance)))


@pytest.mark.parametrize("cells", [16, 32, 64])
def test_plan_around_a_ball_is_little_longer_than_the_shortest_path(cells: int) -> None:
    path = plan(Grid.of(_ball(cells), cells), (-0.9, 0, 0), (0.9, 0, 0))
    assert path.waypoints is not None
    assert path.length is not None
    assert not path.is_straight
    assert path.waypoints[[0, -1]].tolist() == [[-0.9, 0, 0], [0.9, 0, 0]]
    assert _around(0.9, RADIUS) <= path.length + 1e-3 <= 1.1 * _around(0.9, RADIUS + 4 / cells)


def test_plan_past_the_ball_is_the_straight_line() -> None:
    path = plan(Grid.of(_ball(32), 32), (-0.9, 0.8, 0), (0.9, 0.8, 0))
    assert path.is_straight
    assert path.length == pytest.approx(1.8)


@given(st.integers(0, 10**6), st.floats(0, 0.3))
@settings(deadline=None, max_examples=25)
def test_plan_keeps_the_clearance(seed: int, clearance: float) -> None:
    points = _ball(24)
    ends = np.random.default_rng(seed).normal(size=(2, 3))
    start, goal = (0.95 * ends / np.abs(ends).max(axis=1, keepdims=True)).tolist()
    path = plan(Grid.of(points, 24, clearance), start, goal)
    assert path.waypoints is not None
    assert _distance(path.waypoints, points) >= clearance - 1e-5


@pytest.mark.parametrize(
    ("start", "goal", "clearance", "reason"),
    [
        ((0.49, 0, 0), (0.9, 0, 0), 0, "start inside"),
        ((0.9, 0, 0), (0, 0.49, 0), 0, "goal inside"),
        ((0.6, 0, 0), (0.9, 0, 0), 0.2, "start inside"),
        ((0.9, 0, 0), (0, 0, 0), 0, "enclosed"),
        ((0, 0, 0), (0.9, 0, 0), 0, "enclosed"),
    ],
)
def test_plan_without_a_way_says_why(
    start: tuple[float, float, float], goal: tuple[float, float, float], clearance: float, reason: str
) -> None:
    path = plan(Grid.of(_ball(32), 32, clearance), start, goal)
    assert (path.waypoints, path.reason, path.length, path.is_straight) == (None, reason, None, False)


def test_plan_from_a_point_to_itself_has_length_0() -> None:
    path = plan(Grid.of(_ball(32), 32), (0.9, 0, 0), (0.9, 0, 0))
    assert (path.length, path.is_straight, path.reason) == (0, True, None)


def test_path_length_is_the_sum_of_its_segments() -> None:
    assert Path(np.array([[0, 0, 0], [3, 4, 0], [3, 4, 2]], np.float64)).length == 7
