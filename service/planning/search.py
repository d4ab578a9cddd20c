"""Shortest ways from cell to cell of a grid.

The search is Dijkstra's with integer lengths, one array operation for all cells at the same distance (Dial's buckets).
Its paths are as short as those of A*. SciPy's graph search would add 143 MB to the service, half of its size.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from service.planning.grid import Cells, Mask

FAR: Final = np.iinfo(np.int32).max

Integers = npt.NDArray[np.integer[Any]]
_BOX: Final = np.indices((3, 3, 3)).reshape(3, 27).T - 1  # a cell's neighborhood, (27, 3)


@dataclass(frozen=True, eq=False)
class Moves:
    """Moves from a cell to its neighbors; with each its reverse.

    A diagonal move needs every cell free that it touches at a corner or an edge, so that it cuts no corner.

    steps : (m, 3), cells.
    lengths : (m,), in a unit of the moves.
    """

    steps: Cells
    lengths: Integers

    @cached_property
    def needs(self) -> Integers:
        """Bits of the cells in a neighborhood that each move needs free, (m,)."""
        low, high = np.minimum(self.steps, 0), np.maximum(self.steps, 0)  # (m, 3), the box that a move spans
        spanned = ((low[:, None] <= _BOX) & (high[:, None] >= _BOX)).all(axis=2)  # (m, 27)
        needs: Integers = ((spanned & _BOX.any(axis=1)) << np.arange(27)).sum(axis=1, dtype=np.int32)
        return needs

    @cached_property
    def groups(self) -> list[tuple[int, Mask]]:
        """Pairs of a length and the mask of the moves that have it, (m,)."""
        return [(length, self.lengths == length) for length in np.unique(self.lengths).tolist()]


def _moves(lengths: dict[int, int]) -> Moves:
    """Return the moves along 1, 2 or 3 axes, of the given lengths."""
    axes = np.abs(_BOX).sum(axis=1)
    steps = _BOX[np.isin(axes, list(lengths))]
    return Moves(steps, np.array([lengths[count] for count in np.abs(steps).sum(axis=1)]))


RECTILINEAR: Final = _moves({1: 1})  # lengths in L1 (the paper's)
DIAGONAL: Final = _moves({1: 3, 2: 4, 3: 5})  # Borgefors' chamfer lengths: at most 11% off the Euclidean, times 3


def search(
    free: Mask, start: tuple[int, int, int], goal: tuple[int, int, int], moves: Moves = DIAGONAL
) -> Cells | None:
    """Return the cells of a shortest path, as `Graph.path` does."""
    return Graph(free, moves).path(start, goal)


class Graph:
    """The free cells of a grid, and the moves between them. Any number of paths may be searched in it.

    Parameters
    ----------
    free : (n, n, n) bool.
    """

    def __init__(self, free: Mask, moves: Moves = DIAGONAL) -> None:
        self._side = len(free) + 2  # inside a border of blocked cells, so that each has all its neighbors
        self._strides = np.array([self._side**2, self._side, 1])
        self._open_around = _open_around(np.pad(free, 1).ravel(), _BOX @ self._strides)
        self._groups = [(length, moves.steps[at] @ self._strides, moves.needs[at]) for length, at in moves.groups]

    def path(
        self, start: tuple[int, int, int], goal: tuple[int, int, int], ties: np.random.Generator | None = None
    ) -> Cells | None:
        """Return the cells of a shortest path, (m, 3), start and goal included; None if there is none.

        Parameters
        ----------
        start, goal : free cells.
        ties : chooses among paths of the same length, step by step; by default the first in the order of the moves.
        """
        source, target = self._number(start), self._number(goal)
        distance = self._distances(source, target)
        if distance[target] == FAR:
            return None
        path = [target]
        while path[-1] != source:
            before = self._before(path[-1], distance)
            path.append(int(before[0 if ties is None else ties.integers(len(before))]))
        return np.stack(np.unravel_index(path[::-1], (self._side,) * 3), axis=1) - 1

    def _number(self, cell: tuple[int, int, int]) -> int:
        """Return the number of a cell."""
        return int((np.array(cell) + 1) @ self._strides)

    def _distances(self, source: int, target: int) -> Integers:
        """Return lengths of shortest paths from the source, by cells' numbers: exact up to the target's."""
        distance = np.full(self._side**3, FAR, np.int32)
        distance[source] = 0
        last = np.empty(self._side**3, np.int32)  # place of each cell in the cells at hand
        waiting = {0: [np.array([source])]}
        while waiting and distance[target] > (length := min(waiting)):
            cells = np.concatenate(waiting.pop(length))
            places = np.arange(len(cells), dtype=np.int32)
            last[cells] = places
            cells = cells[(last[cells] == places) & (distance[cells] == length)]  # each once; cheaper than a sort
            around = self._open_around[cells][:, None]
            for step, offsets, needs in self._groups:
                reached = (cells[:, None] + offsets)[(around & needs) == needs]
                reached = reached[distance[reached] > length + step]
                if reached.size:
                    distance[reached] = length + step
                    waiting.setdefault(length + step, []).append(reached)
        return distance

    def _before(self, cell: int, distance: Integers) -> Integers:
        """Return the cells from which a shortest path enters a cell."""
        entered = []
        for step, offsets, needs in self._groups:  # each move has its reverse
            others = cell + offsets[(self._open_around[cell] & needs) == needs]
            entered.append(others[distance[others] == distance[cell] - step])
        return np.concatenate(entered)


def _open_around(passable: Mask, offsets: Integers) -> Integers:
    """Return for each cell the bits of the free cells in its neighborhood; 0 for cells at the border."""
    bits = np.zeros(len(passable), np.int32)
    inner = slice(offsets.max(), len(passable) - offsets.max())
    for bit, offset in enumerate(offsets.tolist()):
        bits[inner] |= passable[inner.start + offset : inner.stop + offset].astype(np.int32) << bit
    return bits
