"""The nearest point of a cloud, by a grid over the object frame. Every loss begins with it.

A query searches the cells around its own, in a widening cube, until no point outside the cube can be nearer than the
best one. Where two clouds of thousands of points lie close to each other, that takes some dozens of distances.
"""

from typing import Final

import numba
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

CELLS: Final = 32  # a side of the grid over the unit cube about the origin; points outside count to the nearest cell
FAR: Final = np.float32(1e30)  # fastmath has no infinity

Array = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int64]
Cells = npt.NDArray[np.int32]

_compiled = numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")


def nearest_index(queries: Tensor, targets: Tensor) -> Tensor:
    """Return the index of each query's nearest target, per batch element: (b, n, 3), (b, m, 3) -> (b, n) int64."""
    index = torch.empty(queries.shape[:2], dtype=torch.int64)
    for each in zip(*(points.detach().numpy() for points in (queries, targets)), index.numpy(), strict=True):
        _search(*each)
    return index


@_compiled  # type: ignore[untyped-decorator]
def _search(queries: Array, targets: Array, index: Indices) -> None:  # pragma: no cover - compiled
    """Write the index of each query's (n, 3) nearest target (m, 3) to `index` (n,)."""
    starts, order, points = _sorted(targets)
    for q in range(index.size):
        x, y, z = queries[q, 0], queries[q, 1], queries[q, 2]
        i, j, k = _cell(x), _cell(y), _cell(z)
        best, place, reach = FAR, 0, 1
        while True:
            first, last = max(k - reach, 0), min(k + reach, CELLS - 1)
            for row in range(max(i - reach, 0), min(i + reach, CELLS - 1) + 1):
                for column in range(max(j - reach, 0), min(j + reach, CELLS - 1) + 1):
                    if _gap(row, i) + _gap(column, j) >= best:
                        continue
                    run = (row * CELLS + column) * CELLS
                    start, end = starts[run + first], starts[run + last + 1]
                    best, place = _nearest_of(points, start, end, (x, y, z), best, place)
            cells = min(np.sqrt(best) * CELLS, np.float32(CELLS))
            if cells <= reach:  # every point outside the cube is farther
                break
            reach = min(2 * reach, int(cells) + 1)
        index[q] = order[place]


@_compiled  # type: ignore[untyped-decorator]
def _nearest_of(
    points: Array, start: int, end: int, query: tuple[np.float32, np.float32, np.float32], best: np.float32, place: int
) -> tuple[np.float32, int]:  # pragma: no cover - compiled
    """Return the squared distance and place of the nearest of points `start` to `end`, or `best` and `place`."""
    x, y, z = query
    for t in range(start, end):
        dx, dy, dz = points[t, 0] - x, points[t, 1] - y, points[t, 2] - z
        squared = dx * dx + dy * dy + dz * dz
        if squared < best:
            best, place = squared, t
    return best, place


@_compiled  # type: ignore[untyped-decorator]
def _gap(cell: int, here: int) -> np.float32:  # pragma: no cover - compiled
    """Return the smallest squared distance along an axis between points in these two cells."""
    gap = np.float32(max(abs(cell - here) - 1, 0) / CELLS)
    return gap * gap


@_compiled  # type: ignore[untyped-decorator]
def _sorted(targets: Array) -> tuple[Cells, Cells, Array]:  # pragma: no cover - compiled
    """Sort points by cell: the start of each cell (CELLS^3 + 1,), former indices (m,), and the points (m, 3)."""
    starts, cells = np.zeros(CELLS**3 + 1, np.int32), np.empty(len(targets), np.int32)
    for t in range(len(targets)):
        cell = (_cell(targets[t, 0]) * CELLS + _cell(targets[t, 1])) * CELLS + _cell(targets[t, 2])
        cells[t] = cell
        starts[cell + 1] += 1
    for cell in range(CELLS**3):
        starts[cell + 1] += starts[cell]
    next_place = starts.copy()
    order, points = np.empty(len(targets), np.int32), np.empty_like(targets)
    for t in range(len(targets)):
        place = next_place[cells[t]]
        next_place[cells[t]] += 1
        order[place], points[place] = t, targets[t]
    return starts, order, points


@_compiled  # type: ignore[untyped-decorator]
def _cell(x: float) -> int:  # pragma: no cover - compiled
    """Return the cell of a coordinate along its axis."""
    return min(max(int((x + 0.5) * CELLS), 0), CELLS - 1)
