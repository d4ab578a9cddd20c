"""Find the points of a surface that are visible from outside. Hidden points are no training targets."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from service.drawing.cloud import camera_axes

GRID: Final = 96  # cells per side of a depth image, over a little more than the object frame's diagonal
REACH: Final = 0.9  # half of that side, in longest sides
DEPTH: Final = 0.03  # tolerance behind the nearest point: depth of a slope within a cell
DIRECTIONS: Final = 64
GOLDEN_DEG: Final = 180 * (3 - 5**0.5)

Floats = npt.NDArray[np.float32]


def visible(points: Floats, surface: Floats) -> npt.NDArray[np.bool_]:
    """Return whether each point is visible from any of DIRECTIONS around the object.

    `surface` is splatted into depth images, three cells per side and point.

    Parameters
    ----------
    points : (n, 3), object frame.
    surface : (m, 3), points that may hide them: 40,000 close every hole of a box.

    Returns
    -------
    (n,) bool
    """
    mask = np.zeros(len(points), bool)
    for toward, right, up in _directions():
        nearest = np.full((GRID + 2) ** 2, -np.inf, np.float32)
        np.maximum.at(nearest, _cells(surface, right, up), surface @ toward)
        image = ndimage.maximum_filter(nearest.reshape(GRID + 2, GRID + 2), size=3)
        mask |= points @ toward > image.ravel()[_cells(points, right, up)] - DEPTH
    return mask


def _cells(points: Floats, right: Floats, up: Floats) -> npt.NDArray[np.intp]:
    """Return the cell index of each point; the image has an empty rim of one cell."""
    column, row = ((points @ axis / (2 * REACH) + 0.5) * GRID for axis in (right, up))
    return (row.astype(np.intp) + 1) * (GRID + 2) + column.astype(np.intp) + 1


def _directions() -> list[tuple[Floats, Floats, Floats]]:
    """Return the axes of DIRECTIONS cameras on a spiral around the sphere: toward the camera, right, up."""
    heights = 1 - (2 * np.arange(DIRECTIONS) + 1) / DIRECTIONS
    return [
        camera_axes(90 - GOLDEN_DEG * number, math.degrees(math.asin(height))) for number, height in enumerate(heights)
    ]
