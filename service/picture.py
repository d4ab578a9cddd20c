"""A picture of a point cloud: orthographic, z-buffered, shaded by depth, in its colours if it has any. NumPy only."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from service.mapping import Array, Colors

Bytes = npt.NDArray[np.uint8]

AZIMUTH_DEG: Final = 30.0
ELEVATION_DEG: Final = 22.0
EXTENT: Final = 1.45  # of the object frame, shown from edge to edge: the unit cube fits from any side
NEAR: Final = np.array([44, 72, 120], np.float64)  # RGB of the nearest points
FAR: Final = np.array([176, 196, 222], np.float64)
GROUND: Final = 255
DIMMEST: Final = 0.7  # of their colour's light: the farthest points


def draw(
    points: Array,
    size: int,
    azimuth: float = AZIMUTH_DEG,
    elevation: float = ELEVATION_DEG,
    colors: Colors | None = None,
) -> Bytes:
    """Draw points over white: (n, 3) float32, object frame -> (size, size, 3) uint8 RGB.

    Parameters
    ----------
    colors : of the points, (n, 3) uint8; None for shades of blue.
    azimuth, elevation : of the camera, degrees; azimuth 0 looks at the front (+Z).
    """
    image = np.full((size, size, 3), GROUND, np.uint8)
    flat = image.reshape(-1, 3)
    toward, right, up = camera_axes(azimuth, elevation)
    x, y, depth = points @ right, points @ up, points @ toward
    shade = np.clip((depth + 0.7) / 1.4, 0, 1)[:, None]  # 1 is nearest
    colour = FAR + (NEAR - FAR) * shade if colors is None else colors * (DIMMEST + (1 - DIMMEST) * shade)
    order = np.argsort(depth)  # far to near: the last one written wins
    pixels_per_unit = size / EXTENT
    spread = np.arange(1 + 2 * (size // 320)) - size // 320  # each point covers a small square
    dx, dy = (part.ravel() for part in np.meshgrid(spread, spread))
    columns = np.floor(size / 2 + x[order] * pixels_per_unit).astype(int)[:, None] + dx  # (n, square)
    rows = np.floor(size / 2 - y[order] * pixels_per_unit).astype(int)[:, None] + dy
    seen = (columns >= 0) & (columns < size) & (rows >= 0) & (rows < size)
    flat[(rows * size + columns)[seen]] = np.broadcast_to(colour[order, None], (*seen.shape, 3))[seen]
    return image


def camera_axes(azimuth: float, elevation: float) -> tuple[Array, Array, Array]:
    """Unit vectors, object frame: from the object to the camera, the camera's right, its up (degrees in)."""
    a, e = math.radians(azimuth), math.radians(elevation)
    toward = np.array([math.sin(a) * math.cos(e), math.sin(e), math.cos(a) * math.cos(e)], np.float32)
    right = np.array([math.cos(a), 0, -math.sin(a)], np.float32)
    return toward, right, np.cross(toward, right)
