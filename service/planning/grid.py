"""Occupancy grid of an object: which cells of the cube [-1, 1]^3 are free (paper, path planning experiment)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from service.mapping.spec import Array

HALF: Final = 1.0  # half a side of the cube, in longest sides of the object
TOUCH: Final = 1e-6  # cells: a point this near to a border belongs to the cells on both sides

Floats = npt.NDArray[np.float64]
Cells = npt.NDArray[np.int64]  # (n, 3), indices of cells along x, y and z
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Grid:
    """The free cells of the cube [-1, 1]^3, in the object frame.

    free : (n, n, n) bool, indexed by x, y and z.
    """

    free: Mask

    @classmethod
    def of(cls, points: Array, cells: int, clearance: float = 0.0) -> "Grid":
        """Return the grid around points, (m, 3). Points outside the cube count for nothing.

        A cell is not free if it holds a point, or if it is nearer than `clearance` to such a cell. So whatever stays in
        free cells keeps this distance from all points.

        Parameters
        ----------
        cells : along each side of the cube.
        clearance : smallest distance from the points, in longest sides.
        """
        inside = points[(np.abs(points) <= HALF).all(axis=1)]
        occupied = np.zeros((cells,) * 3, np.bool_)
        occupied[tuple(_cells(inside, cells).T)] = True
        return cls(~_grown(occupied, clearance / (2 * HALF / cells)))

    @property
    def cells(self) -> int:
        """Number of cells along each side."""
        return len(self.free)

    def cell(self, point: Sequence[float]) -> tuple[int, int, int]:
        """Return the cell that holds a point of the cube."""
        x, y, z = _cells(np.array(point, np.float64), self.cells).tolist()
        return x, y, z

    def is_free(self, point: Sequence[float]) -> bool:
        """Return whether a point of the cube lies in a free cell."""
        return bool(self.free[self.cell(point)])

    def centers(self, cells: Cells) -> Floats:
        """Return the middles of cells: (m, 3) -> (m, 3)."""
        return (cells.astype(np.float64) + 0.5) * (2 * HALF / self.cells) - HALF

    def sees(self, start: Floats, end: Floats) -> bool:
        """Return whether all cells that a segment touches are free, those that it only grazes included."""
        a, b = (start + HALF) * (self.cells / (2 * HALF)), (end + HALF) * (self.cells / (2 * HALF))
        touched = a + np.concatenate([[0.0], _crossings(a, b), [1.0]])[:, None] * (b - a)  # (m, 3), in cells
        corners = touched[:, None] + TOUCH * _CORNERS  # (m, 8, 3)
        cells = np.clip(np.floor(corners).astype(np.int64), 0, self.cells - 1).reshape(-1, 3)
        return bool(self.free[tuple(cells.T)].all())


_CORNERS: Final = np.indices((2, 2, 2)).reshape(3, 8).T * 2.0 - 1


def _cells(points: npt.NDArray[np.floating], cells: int) -> Cells:
    """Return the cell of each point of the cube: (..., 3) -> (..., 3)."""
    steps = np.floor((points + HALF) * (cells / (2 * HALF))).astype(np.int64)
    clipped: Cells = np.clip(steps, 0, cells - 1)  # the far sides of the cube belong to the last cells
    return clipped


def _crossings(a: Floats, b: Floats) -> Floats:
    """Return where the segment from a to b, in cells, crosses borders between cells: shares of its length, (m,)."""
    shares = [
        (np.arange(np.floor(min(p, q)) + 1, np.ceil(max(p, q))) - p) / (q - p)
        for p, q in zip(a, b, strict=True)
        if p != q
    ]
    return np.concatenate(shares) if shares else np.zeros(0)


def _grown(occupied: Mask, clearance: float) -> Mask:
    """Return the occupied cells and those nearer to one than a number of cells, measured between their borders.

    The squared distance is a sum over the axes, so one pass along each axis gives its minimum.
    """
    reach = int(np.ceil(clearance))
    if not reach:
        return occupied
    far = np.float32(3 * len(occupied) ** 2 + 1)
    squared = np.where(occupied, np.float32(0), far)
    for axis in range(3):
        lines = np.moveaxis(squared, axis, 0)
        nearest = lines.copy()
        for shift in range(1, min(reach + 1, len(lines))):
            gap = np.float32((shift - 1) ** 2)
            np.minimum(nearest[shift:], lines[:-shift] + gap, out=nearest[shift:])
            np.minimum(nearest[:-shift], lines[shift:] + gap, out=nearest[:-shift])
        squared = np.moveaxis(nearest, 0, axis)
    grown: Mask = occupied | (squared < clearance**2)
    return grown
