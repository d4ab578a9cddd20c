"""Which points of a surface can be seen from outside: what no image shows is no target for training."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from service.drawing.cloud import camera_axes

GRID: Final = 96  # cells a side of a depth image, over a little more than the object frame's diagonal
REACH: Final = 0.9  # half of that side, longest sides
DEPTH: Final = 0.03  # how far behind the nearest point a point is still seen: what a slope covers in a cell
DIRECTIONS: Final = 64
GOLDEN_DEG: Final = 180 * (3 - 5**0.5)

Floats = npt.NDArray[np.float32]


def visible(points: Floats, surface: Floats) -> npt.NDArray[np.bool_]:
    """Whether each point is seen from any of DIRECTIONS around the object, by depth images that `surface` is
    splatted into, three cells a side each.

    Parameters
    ----------
    points : (n, 3), object frame.
    surface : (m, 3), what may hide them: 40,000 close every hole of a box.

    Returns
    -------
    (n,) bool
    """
    seen = np.zeros(len(points), bool)
    for toward, right, up in _directions():
        nearest = np.full((GRID + 2) ** 2, -np.inf, np.float32)
        np.maximum.at(nearest, _cells(surface, right, up), surface @ toward)
        image = ndimage.maximum_filter(nearest.reshape(GRID + 2, GRID + 2), size=3)
        seen |= points @ toward > image.ravel()[_cells(points, right, up)] - DEPTH
    return seen


def _cells(points: Floats, right: Floats, up: Floats) -> npt.NDArray[np.intp]:
    """The number of the cell that each point falls into; the image has an empty rim of one cell."""
    column, row = ((points @ axis / (2 * REACH) + 0.5) * GRID for axis in (right, up))
    return (row.astype(np.intp) + 1) * (GRID + 2) + column.astype(np.intp) + 1


def _directions() -> list[tuple[Floats, Floats, Floats]]:
    """Axes of DIRECTIONS cameras: toward each, its right and its up. A spiral on the sphere."""
    heights = 1 - (2 * np.arange(DIRECTIONS) + 1) / DIRECTIONS
    return [
        camera_axes(90 - GOLDEN_DEG * number, math.degrees(math.asin(height))) for number, height in enumerate(heights)
    ]
