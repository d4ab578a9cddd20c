"""The nearest point of a cloud, by a grid over the object frame: what every loss begins with.

A query looks at the cells around its own, in a widening cube, until nothing outside of it can be nearer than what it
has found. Where two clouds of thousands of points lie close to each other, that takes some dozens of distances.
"""

from typing import Final

import numba
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

CELLS: Final = 32  # a side of the grid over the unit cube about the origin; points outside belong to the nearest cell
FAR: Final = np.float32(1e30)  # fastmath knows no infinity

Array = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int64]
Cells = npt.NDArray[np.int32]

_compiled = numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")


def nearest(queries: Tensor, targets: Tensor) -> Tensor:
    """Index of each query's nearest target, per batch element: (b, n, 3), (b, m, 3) -> (b, n) int64."""
    found = torch.empty(queries.shape[:2], dtype=torch.int64)
    for each in zip(*(points.detach().numpy() for points in (queries, targets)), found.numpy(), strict=True):
        _search(*each)
    return found


@_compiled  # type: ignore[untyped-decorator]
def _search(queries: Array, targets: Array, found: Indices) -> None:  # pragma: no cover - compiled
    """Queries (n, 3) and targets (m, 3) -> found (n,)."""
    starts, order, points = _sorted(targets)
    for q in range(found.size):
        x, y, z = queries[q, 0], queries[q, 1], queries[q, 2]
        i, j, k = _cell(x), _cell(y), _cell(z)
        best, index, reach = FAR, 0, 1
        while True:
            first, last = max(k - reach, 0), min(k + reach, CELLS - 1)
            for row in range(max(i - reach, 0), min(i + reach, CELLS - 1) + 1):
                for column in range(max(j - reach, 0), min(j + reach, CELLS - 1) + 1):
                    if _gap(row, i) + _gap(column, j) >= best:
                        continue
                    run = (row * CELLS + column) * CELLS
                    start, end = starts[run + first], starts[run + last + 1]
                    best, index = _nearest_of(points, start, end, (x, y, z), best, index)
            cells = min(np.sqrt(best) * CELLS, np.float32(CELLS))
            if cells <= reach:  # all that was not looked at is farther
                break
            reach = min(2 * reach, int(cells) + 1)
        found[q] = order[index]


@_compiled  # type: ignore[untyped-decorator]
def _nearest_of(
    points: Array, start: int, end: int, query: tuple[np.float32, np.float32, np.float32], best: np.float32, index: int
) -> tuple[np.float32, int]:  # pragma: no cover - compiled
    """The squared distance and the number of the nearest of points `start` to `end`, if it beats what was found."""
    x, y, z = query
    for t in range(start, end):
        dx, dy, dz = points[t, 0] - x, points[t, 1] - y, points[t, 2] - z
        squared = dx * dx + dy * dy + dz * dz
        if squared < best:
            best, index = squared, t
    return best, index


@_compiled  # type: ignore[untyped-decorator]
def _gap(cell: int, here: int) -> np.float32:  # pragma: no cover - compiled
    """What two points in these cells of an axis are apart at least, squared."""
    apart = np.float32(max(abs(cell - here) - 1, 0) / CELLS)
    return apart * apart


@_compiled  # type: ignore[untyped-decorator]
def _sorted(targets: Array) -> tuple[Cells, Cells, Array]:  # pragma: no cover - compiled
    """Where each cell's points start, (CELLS^3 + 1,); the points (m, 3) by cell, and which they were, (m,)."""
    starts, cells = np.zeros(CELLS**3 + 1, np.int32), np.empty(len(targets), np.int32)
    for t in range(len(targets)):
        cell = (_cell(targets[t, 0]) * CELLS + _cell(targets[t, 1])) * CELLS + _cell(targets[t, 2])
        cells[t] = cell
        starts[cell + 1] += 1
    for cell in range(CELLS**3):
        starts[cell + 1] += starts[cell]
    following = starts.copy()
    order, points = np.empty(len(targets), np.int32), np.empty_like(targets)
    for t in range(len(targets)):
        place = following[cells[t]]
        following[cells[t]] += 1
        order[place], points[place] = t, targets[t]
    return starts, order, points


@_compiled  # type: ignore[untyped-decorator]
def _cell(x: float) -> int:  # pragma: no cover - compiled
    return min(max(int((x + 0.5) * CELLS), 0), CELLS - 1)
