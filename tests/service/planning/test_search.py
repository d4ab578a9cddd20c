"""Shortest ways through a grid, compared with SciPy's."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from service.planning.grid import Cells, Mask
from service.planning.search import DIAGONAL, RECTILINEAR, Graph, Moves, search

SIDE = 6
START, GOAL = (0, 0, 0), (SIDE - 1, SIDE - 1, SIDE - 1)


def _free(seed: int, share: float) -> Mask:
    free: Mask = np.random.default_rng(seed).random((SIDE,) * 3) < share
    free[START] = free[GOAL] = True
    return free


def _is_allowed(free: Mask, cell: Cells, step: Cells) -> bool:
    """Return whether every cell of the box that a move spans is free."""
    low, high = np.minimum(cell, cell + step), np.maximum(cell, cell + step)
    if low.min() < 0 or high.max() >= SIDE:
        return False
    box = tuple(slice(a, b + 1) for a, b in zip(low, high, strict=True))
    return bool(free[box].all())


def _length(path: Cells, moves: Moves) -> int:
    lengths = {tuple(step): int(length) for step, length in zip(moves.steps.tolist(), moves.lengths, strict=True)}
    return sum(lengths[tuple(step)] for step in np.diff(path, axis=0).tolist())


def _shortest(free: Mask, moves: Moves) -> float:
    edges = [
        (np.ravel_multi_index(cell, free.shape), np.ravel_multi_index(tuple(np.array(cell) + step), free.shape), length)
        for cell in itertools.product(range(SIDE), repeat=3)
        for step, length in zip(moves.steps, moves.lengths, strict=True)
        if _is_allowed(free, np.array(cell), step)
    ]
    sources, targets, lengths = zip(*edges, strict=True)
    graph = coo_array((lengths, (sources, targets)), shape=(SIDE**3, SIDE**3)).tocsr()
    return float(dijkstra(graph, indices=0)[SIDE**3 - 1])


def test_moves_have_their_directions_and_lengths() -> None:
    assert (len(RECTILINEAR.steps), len(DIAGONAL.steps)) == (6, 26)
    assert [int((DIAGONAL.lengths == length).sum()) for length in (3, 4, 5)] == [6, 12, 8]
    euclidean = 3 * np.linalg.norm(DIAGONAL.steps, axis=1)
    assert np.abs(DIAGONAL.lengths / euclidean - 1).max() < 0.11


@pytest.mark.parametrize("moves", [RECTILINEAR, DIAGONAL], ids=["rectilinear", "diagonal"])
@given(st.integers(0, 10**6), st.sampled_from([0.55, 0.7, 0.85, 1.0]))
@settings(deadline=None, max_examples=25)
def test_search_path_is_allowed_and_as_short_as_scipy_says(moves: Moves, seed: int, share: float) -> None:
    free = _free(seed, share)
    path, shortest = search(free, START, GOAL, moves), _shortest(free, moves)
    if path is None:
        assert np.isinf(shortest)
        return
    assert (tuple(path[0]), tuple(path[-1])) == (START, GOAL)
    assert all(_is_allowed(free, cell, step) for cell, step in zip(path, np.diff(path, axis=0), strict=False))
    assert _length(path, moves) == shortest


def test_search_from_a_cell_to_itself_is_that_cell() -> None:
    path = search(np.ones((8, 8, 8), np.bool_), (1, 2, 3), (1, 2, 3))
    assert path is not None
    assert path.tolist() == [[1, 2, 3]]


def test_search_diagonally_cuts_no_corner() -> None:
    free = np.ones((2, 2, 1), np.bool_)
    free[0, 1] = False
    path = search(np.pad(free, ((0, 0), (0, 0), (0, 1)))[:, :, :1].repeat(2, axis=2), (0, 0, 0), (1, 1, 0))
    assert path is not None
    assert path.tolist() == [[0, 0, 0], [1, 0, 0], [1, 1, 0]]


def test_search_with_ties_takes_other_paths_of_the_same_length() -> None:
    free = np.ones((8, 8, 8), np.bool_)
    graph = Graph(free, RECTILINEAR)
    paths = [graph.path((0, 0, 0), (7, 7, 7), np.random.default_rng(seed)) for seed in (1, 1, 2)]
    first, same, other = (path.tolist() for path in paths if path is not None)
    assert first == same != other
    assert len(first) == len(other) == 22
