"""A picture of a point cloud: orthographic, each point a disc, the nearest one seen, lit by depth alone. NumPy only."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from service.mapping.spec import Array, Colors

Bytes = npt.NDArray[np.uint8]

AZIMUTH_DEG: Final = 30.0
ELEVATION_DEG: Final = 22.0
EXTENT: Final = 1.45  # of the object frame, shown from edge to edge: the unit cube fits from any side
NEAR: Final = np.array([96, 134, 188], np.float64)  # RGB of the nearest points
FAR: Final = np.array([176, 196, 222], np.float64)
GROUND: Final = 255
SUPERSAMPLING: Final = 2
DIMMEST: Final = 0.7  # of their colour's light: the farthest points
DISC: Final = (
    0.8  # a disc's radius, in sides of the picture over the root of the number of points: so that surfaces close
)
WIDEST: Final = 1 / 75  # the same, in sides, for few points
REACHES: Final = (1 / 160, 1 / 80, 1 / 40)  # sides: how far around a pixel something may shade it
DEEPEST: Final = 0.15  # longest sides: what is nearer by more shades no more than that
SHADE: Final = 10.0  # how dark: light falls by 1 / e where all around is nearer by 1 / SHADE
BEHIND: Final = -10.0  # the depth of the ground


def draw(
    points: Array,
    size: int,
    azimuth: float = AZIMUTH_DEG,
    elevation: float = ELEVATION_DEG,
    colors: Colors | None = None,
) -> Bytes:
    """Draw points over white, with smooth edges: (n, 3) float32, object frame -> (size, size, 3) uint8 RGB.

    Parameters
    ----------
    colors : of the points, (n, 3) uint8; None for shades of blue.
    azimuth, elevation : of the camera, degrees; azimuth 0 looks at the front (+Z).
    """
    toward, right, up = camera_axes(azimuth, elevation)
    depth = points @ toward
    nearest = _nearest(np.stack([points @ right, -(points @ up)], axis=1), depth, SUPERSAMPLING * size)
    shade = np.clip((depth + 0.7) / 1.4, 0, 1)[:, None]  # 1 is nearest
    colour = FAR + (NEAR - FAR) * shade if colors is None else colors * (DIMMEST + (1 - DIMMEST) * shade)
    is_ground = nearest < 0
    light = _light(np.where(is_ground, np.float32(BEHIND), depth[nearest]))
    image = colour[nearest] * light[..., None]
    image[is_ground] = GROUND
    smooth: Bytes = image.reshape(size, SUPERSAMPLING, size, SUPERSAMPLING, 3).mean(axis=(1, 3)).astype(np.uint8)
    return smooth


def _nearest(places: Array, depth: Array, size: int) -> npt.NDArray[np.intp]:
    """The number of the point that each pixel shows, (size, size), -1 for none; `places` (n, 2) are right and down."""
    radius = size * min(DISC / len(places) ** 0.5, WIDEST)
    spread = np.arange(-math.floor(radius), math.floor(radius) + 1)
    dx, dy = (part.ravel() for part in np.meshgrid(spread, spread))
    is_disc = dx**2 + dy**2 <= radius**2
    order = np.argsort(depth)  # far to near: the last one written wins
    columns, rows = np.floor(size / 2 + places[order].T * (size / EXTENT)).astype(int)[:, :, None]
    columns, rows = columns + dx[is_disc], rows + dy[is_disc]  # (n, disc)
    seen = (columns >= 0) & (columns < size) & (rows >= 0) & (rows < size)
    shown = np.full(size * size, -1)
    shown[(rows * size + columns)[seen]] = np.broadcast_to(order[:, None], seen.shape)[seen]
    return shown.reshape(size, size)


def _light(depth: Array) -> Array:
    """Eye-dome lighting (Boucheny 2009): (h, w) -> (h, w), a pixel is the darker the more around it is nearer."""
    height, width = depth.shape
    nearer = np.zeros_like(depth)
    for reach in REACHES:
        step = max(1, round(reach * width))
        padded = np.pad(depth, step, constant_values=BEHIND)
        for down in (0, step, 2 * step):
            for across in (0, step, 2 * step):
                beside = padded[down : down + height, across : across + width]
                nearer += np.clip(beside - depth, 0, DEEPEST)
    light: Array = np.exp(-SHADE / (8 * len(REACHES)) * nearer)
    return light


def camera_axes(azimuth: float, elevation: float) -> tuple[Array, Array, Array]:
    """Unit vectors, object frame: from the object to the camera, the camera's right, its up (degrees in)."""
    a, e = math.radians(azimuth), math.radians(elevation)
    toward = np.array([math.sin(a) * math.cos(e), math.sin(e), math.cos(a) * math.cos(e)], np.float32)
    right = np.array([math.cos(a), 0, -math.sin(a)], np.float32)
    return toward, right, np.cross(toward, right)
