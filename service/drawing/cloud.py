"""A picture of a point cloud: orthographic, each point a disc, shaded by depth alone. NumPy only."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

from service.mapping.spec import Array, Colors

Bytes = npt.NDArray[np.uint8]

AZIMUTH_DEG: Final = 30.0
ELEVATION_DEG: Final = 22.0
EXTENT: Final = 1.45  # width of the picture in the object frame; the unit cube fits from any side
NEAR: Final = np.array([96, 134, 188], np.float64)  # RGB of the nearest points
FAR: Final = np.array([176, 196, 222], np.float64)
GROUND: Final = 255
SUPERSAMPLING: Final = 2
DIMMEST: Final = 0.7  # brightness of the farthest colored points, relative to the nearest
DISC: Final = 0.8  # radius of n points' discs is DISC / sqrt(n) of the picture's side: surfaces have no holes
WIDEST: Final = 1 / 75  # largest radius of a disc, share of the picture's side
REACHES: Final = (1 / 160, 1 / 80, 1 / 40)  # distances at which a pixel may be shaded, shares of the picture's side
DEEPEST: Final = 0.15  # object frame; a larger difference in depth shades no more than this
SHADE: Final = 10.0  # light falls to 1 / e if all neighbors are nearer by 1 / SHADE
BEHIND: Final = -10.0  # depth of the background


def draw(
    points: Array,
    size: int,
    azimuth: float = AZIMUTH_DEG,
    elevation: float = ELEVATION_DEG,
    colors: Colors | None = None,
) -> Bytes:
    """Draw points over white, with smooth edges.

    Parameters
    ----------
    points : (n, 3) float32, object frame.
    size : side of the picture, pixels.
    azimuth, elevation : direction of the camera, degrees; azimuth 0 looks at the front (+Z).
    colors : (n, 3) uint8; None for shades of blue.

    Returns
    -------
    (size, size, 3) uint8, RGB.
    """
    toward, right, up = camera_axes(azimuth, elevation)
    depth = points @ toward
    visible = _visible_points(np.stack([points @ right, -(points @ up)], axis=1), depth, SUPERSAMPLING * size)
    shade = np.clip((depth + 0.7) / 1.4, 0, 1)[:, None]  # 1 is nearest
    color = FAR + (NEAR - FAR) * shade if colors is None else colors * (DIMMEST + (1 - DIMMEST) * shade)
    is_ground = visible < 0
    light = eye_dome(np.where(is_ground, np.float32(BEHIND), depth[visible]))
    image = color[visible] * light[..., None]
    image[is_ground] = GROUND
    smooth: Bytes = image.reshape(size, SUPERSAMPLING, size, SUPERSAMPLING, 3).mean(axis=(1, 3)).astype(np.uint8)
    return smooth


def _visible_points(places: Array, depth: Array, size: int) -> npt.NDArray[np.intp]:
    """Return the index of the nearest point at each pixel, (size, size), or -1; `places` (n, 2) are right and down."""
    radius = size * min(DISC / len(places) ** 0.5, WIDEST)
    spread = np.arange(-math.floor(radius), math.floor(radius) + 1)
    dx, dy = (part.ravel() for part in np.meshgrid(spread, spread))
    is_disc = dx**2 + dy**2 <= radius**2
    order = np.argsort(depth)  # far to near: nearer points overwrite
    columns, rows = np.floor(size / 2 + places[order].T * (size / EXTENT)).astype(int)[:, :, None]
    columns, rows = columns + dx[is_disc], rows + dy[is_disc]  # (n, disc)
    inside = (columns >= 0) & (columns < size) & (rows >= 0) & (rows < size)
    visible = np.full(size * size, -1)
    visible[(rows * size + columns)[inside]] = np.broadcast_to(order[:, None], inside.shape)[inside]
    return visible.reshape(size, size)


def eye_dome(depth: Array) -> Array:
    """Compute eye-dome lighting (Boucheny 2009), (h, w) -> (h, w): the nearer its neighbors, the darker a pixel."""
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
    """Return unit vectors in the object frame: toward the camera, its right and its up. Angles are in degrees."""
    a, e = math.radians(azimuth), math.radians(elevation)
    toward = np.array([math.sin(a) * math.cos(e), math.sin(e), math.cos(a) * math.cos(e)], np.float32)
    right = np.array([math.cos(a), 0, -math.sin(a)], np.float32)
    return toward, right, np.cross(toward, right)
