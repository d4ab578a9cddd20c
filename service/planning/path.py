"""A path from start to goal around an object: the straight line, or a shortest way through free cells, pulled tight."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from service.planning.grid import Floats, Grid
from service.planning.search import search

Reason = Literal["start inside", "goal inside", "enclosed"]
CELLS: Final = (8, 64)  # fewest and most along each side
POINTS_PER_CELL: Final = 64  # of one side of the cube: the cells of a surface then hold several of the object's points


@dataclass(frozen=True, eq=False)
class Path:
    """The result of planning.

    waypoints : (m, 3) float64, from start to goal, to be joined by straight lines; None if there is no path.
    reason : None if there is a path. `start inside` and `goal inside`: the cell there is not free. `enclosed`: both
        are free, but no way of free cells joins them.
    """

    waypoints: Floats | None
    reason: Reason | None = None

    @property
    def length(self) -> float | None:
        """Euclidean length, in the unit of the waypoints; None if there is no path."""
        if self.waypoints is None:
            return None
        return float(np.linalg.norm(np.diff(self.waypoints, axis=0), axis=1).sum())

    @property
    def is_straight(self) -> bool:
        """Return whether the path is the straight line from start to goal."""
        return self.waypoints is not None and len(self.waypoints) == 2


def points_for(cells: int) -> int:
    """Return how many points of an object fill a grid with this many cells along each side."""
    return POINTS_PER_CELL * cells**2


def plan(grid: Grid, start: Sequence[float], goal: Sequence[float]) -> Path:
    """Plan a path between two points of the cube [-1, 1]^3, in the object frame. It stays in free cells.

    The path is short, not the shortest: the way through the cells is a shortest one for moves to the 26 neighbors, and
    then waypoints are left out where the straight line is free.
    """
    if not grid.is_free(start):
        return Path(None, "start inside")
    if not grid.is_free(goal):
        return Path(None, "goal inside")
    ends = np.array([start, goal], np.float64)
    if grid.sees(*ends):
        return Path(ends)
    cells = search(grid.free, grid.cell(start), grid.cell(goal))
    if cells is None:
        return Path(None, "enclosed")
    return Path(_tight(grid, np.concatenate([ends[:1], grid.centers(cells), ends[1:]])))


def _tight(grid: Grid, waypoints: Floats) -> Floats:
    """Go from each waypoint straight to the last one that it sees, else to the next."""
    kept, last = [0], len(waypoints) - 1
    while kept[-1] < last:
        here = kept[-1]
        kept.append(
            next((at for at in range(last, here + 1, -1) if grid.sees(waypoints[here], waypoints[at])), here + 1)
        )
    return waypoints[kept]
