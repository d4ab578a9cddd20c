"""A picture of a surface: orthographic, softly lit, over its shadow on the ground. NumPy only.

The light is that of the page's stage (service/viewer/static/js/stage): surface.js, ground.js and eyedome.js.
"""

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from service.drawing.cloud import (
    AZIMUTH_DEG,
    BEHIND,
    ELEVATION_DEG,
    EXTENT,
    FAR,
    GROUND,
    NEAR,
    SUPERSAMPLING,
    Bytes,
    camera_axes,
    eye_dome,
)
from service.mapping.color import linear
from service.mapping.spec import Array
from service.mapping.surface import Surface
from service.mapping.tears import Indices

COARSE: Final = 200  # side of the picture that finds hidden triangles, pixels
DOTS: Final = 4  # of a triangle on each of its pixels there
MOST_PARTS: Final = 12  # of a triangle's edges, for dots
AT_A_TIME: Final = 2**15  # pixels of triangles, or dots; what is computed of them stays in the processor's cache
MOST_LAYERS: Final = 16  # triangles for each pixel of the supersampled picture, on average; an object has 1 to 14
KEY_LIGHT: Final = np.array([-0.4, 0.6, 0.8], np.float32) / np.float32(1.16**0.5)  # right, up, toward the camera
SHINE_LIGHT: Final = np.array([-0.3, 0.5, 1.3], np.float32) / np.float32(2.03**0.5)
SHADOW: Final = 0.3  # how dark the ground is under the object's middle
SPREAD: Final = 1.7  # side of the shadow, relative to the object's
BELOW: Final = 0.005  # object frame; from the object's lowest point down to the ground


@dataclass(frozen=True, eq=False)
class Seen:
    """The pixels that show a surface, p of them.

    pixels : (p,) their numbers, row by row.
    corners : (p, 3) the vertices of the triangle at each.
    weights : (p, 3) float32, how near the pixel is to each of them; they sum to 1.
    """

    pixels: npt.NDArray[np.intp]
    corners: Indices
    weights: Array

    def mean(self, values: Array) -> Array:
        """Interpolate values of the vertices, (v, ...), to the pixels: (p, ...)."""
        shares = self.weights.reshape(-1, 3, *[1] * (values.ndim - 1))
        first, second, third = (values[self.corners[:, corner]] * shares[:, corner] for corner in range(3))
        mean: Array = first + second + third
        return mean


def draw_surface(surface: Surface, size: int, azimuth: float = AZIMUTH_DEG, elevation: float = ELEVATION_DEG) -> Bytes:
    """Draw a surface over white, with smooth edges, in its colors or in shades of blue.

    Parameters
    ----------
    surface : in the object frame.
    size : side of the picture, pixels.
    azimuth, elevation : direction of the camera, degrees; azimuth 0 looks at the front (+Z).

    Returns
    -------
    (size, size, 3) uint8, RGB.
    """
    toward, right, up = camera_axes(azimuth, elevation)
    axes = np.stack([right, up, toward])
    side = SUPERSAMPLING * size
    viewed = surface.vertices @ axes.T
    raster = _rasterize(viewed, _without_hidden(viewed, surface.triangles, COARSE), side)
    depth = np.full(side * side, BEHIND, np.float32)
    depth[raster.pixels] = raster.mean(viewed[:, 2])
    image = np.repeat(_ground(surface.vertices, side, axes)[:, None], 3, axis=1)
    light = _edges(depth.reshape(side, side)).ravel()[raster.pixels]
    image[raster.pixels] = raster.mean(_shaded(surface, viewed[:, 2], axes)) * light[:, None]
    smooth = image.reshape(size, SUPERSAMPLING, size, SUPERSAMPLING, 3).mean(axis=(1, 3)).round()
    drawn: Bytes = smooth.astype(np.uint8)
    return drawn


def _without_hidden(viewed: Array, triangles: Indices, side: int) -> Indices:
    """Leave out triangles behind others, such as the inner layers of a solid; those left are sorted from far to near.

    Each triangle leaves dots on a coarse picture of `side` pixels. Those whose dots are not covered
    by nearer ones are kept, and all that touch them.
    """
    triangles = triangles[np.argsort(viewed[:, 2][triangles].sum(axis=1))]
    corners = _places(viewed, side)[triangles]  # (t, 3, 2)
    parts = np.sqrt(DOTS / 2 * _doubled_areas(corners)).astype(np.intp).clip(0, MOST_PARTS - 1) + 1
    nearest = np.full(side * side, -1)
    for each in range(1, MOST_PARTS + 1):
        (of_size,) = np.nonzero(parts == each)
        for some in np.array_split(of_size, len(of_size) * each**2 // AT_A_TIME + 1):
            dots = np.rint(_middles(each) @ corners[some]).clip(0, side - 1).astype(np.intp)  # (t, each^2, 2)
            dotted = np.full(side * side, -1)
            dotted[(dots[..., 1] * side + dots[..., 0]).ravel()] = np.repeat(some, each**2)
            np.maximum(nearest, dotted, out=nearest)
    touched = np.zeros(len(viewed), np.bool_)
    touched[triangles[nearest[nearest >= 0]]] = True
    kept: Indices = triangles[touched[triangles].any(axis=1)]
    return kept


@lru_cache
def _middles(parts: int) -> Array:
    """Return the middles of the parts of a triangle whose edges are divided in so many: weights, (parts^2, 3)."""
    up = [(i + 1 / 3, j + 1 / 3) for i in range(parts) for j in range(parts - i)]
    down = [(i + 2 / 3, j + 2 / 3) for i in range(parts - 1) for j in range(parts - 1 - i)]
    weights = np.array(up + down) / parts
    middles: Array = np.column_stack([weights, 1 - weights.sum(axis=1)]).astype(np.float32)
    return middles


def _doubled_areas(corners: Array) -> Array:
    """Return twice the area of triangles (t, 3, 2)."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas: Array = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    return areas


def _places(viewed: Array, side: int) -> Array:
    """Return where vertices are in a square picture of `side` pixels, (v, 2): column and row of pixels' middles."""
    places: Array = viewed[:, :2] * np.array([side / EXTENT, -side / EXTENT], np.float32) + np.float32((side - 1) / 2)
    return places


def _rasterize(viewed: Array, triangles: Indices, side: int) -> Seen:
    """Find the triangle at each pixel of a square picture: the last one, so the nearest of triangles from far to near.

    Parameters
    ----------
    viewed : (v, 3) vertices: right, up, toward the camera.
    side : of the picture, pixels.
    """
    places = _places(viewed, side)
    triangles, counts = _few(places, triangles, side)
    edges = _edge_functions(places[triangles])
    heights = places[:, 1][triangles]
    nearest = np.full(side * side, -1)
    cuts = np.flatnonzero(np.diff(np.cumsum(counts) // AT_A_TIME)) + 1
    for begin, end in pairwise([0, *cuts.tolist(), len(triangles)]):
        pixels, owners = _filled(heights[begin:end], edges[begin:end], side)
        nearest[pixels] = owners + begin
    pixels = np.flatnonzero(nearest >= 0)
    owners = nearest[pixels]
    rows, columns = np.divmod(pixels, side)
    a, b, c = np.moveaxis(edges[owners], 2, 0)
    weights = a * columns[:, None] + b * rows[:, None] + c
    return Seen(pixels, triangles[owners], weights.astype(np.float32))


def _few(places: Array, triangles: Indices, side: int) -> tuple[Indices, Array]:
    """Leave out triangles that are seen from their side, and the largest ones beyond MOST_LAYERS on the picture.

    Weights from elsewhere may give thousands of triangles that each span the picture.

    Parameters
    ----------
    places : (v, 2) vertices in a picture of `side` pixels.

    Returns
    -------
    The triangles that are kept, in their order, and how many pixels each has, at most about so many.
    """
    areas = _doubled_areas(places[triangles])
    triangles, areas = triangles[areas > 0], areas[areas > 0]
    width, height = np.ptp(np.clip(places, 0, side)[triangles], axis=1).T
    counts = np.minimum(areas / 2, width * height) + height + 1
    smallest_first = np.argsort(counts, kind="stable")
    kept = np.zeros(len(triangles), np.bool_)
    kept[smallest_first[np.cumsum(counts[smallest_first], dtype=np.float64) <= MOST_LAYERS * side**2]] = True
    return triangles[kept], counts[kept]


def _edge_functions(corners: Array) -> Array:
    """Return (a, b, c) for each corner of triangles (t, 3, 2): a x + b y + c is its weight at a pixel, (t, 3, 3)."""
    corners = corners.astype(np.float64)  # differences of products
    after, last = corners[:, [1, 2, 0]], corners[:, [2, 0, 1]]
    a = after[..., 1] - last[..., 1]
    b = last[..., 0] - after[..., 0]
    c = after[..., 0] * last[..., 1] - last[..., 0] * after[..., 1]
    with np.errstate(divide="ignore", invalid="ignore"):  # triangles that are seen from their side
        edges: Array = np.stack([a, b, c], axis=2) / c.sum(axis=1)[:, None, None]
    return edges


def _filled(heights: Array, edges: Array, side: int) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return the pixels inside of triangles, in the triangles' order, and the triangle of each.

    Parameters
    ----------
    heights : (t, 3) rows of the corners.
    edges : (t, 3, 3), of `_edge_functions`.
    """
    first = np.clip(np.ceil(heights.min(axis=1)), 0, side).astype(np.intp)
    last = np.clip(np.floor(heights.max(axis=1)), -1, side - 1).astype(np.intp)
    rows, owners = _runs(first, last, np.arange(len(edges)))
    left, right = np.zeros(len(rows)), np.full(len(rows), side - 1.0)
    for corner in range(3):
        a, b, c = edges[:, corner].T
        with np.errstate(divide="ignore", invalid="ignore"):
            bound = (-b / a)[owners] * rows + (-c / a)[owners]
        np.maximum(left, bound, out=left, where=(a > 0)[owners])
        np.minimum(right, bound, out=right, where=(a < 0)[owners])
    row_starts = rows * side
    begin, end = np.ceil(left).astype(np.intp), np.floor(right).astype(np.intp)
    return _runs(row_starts + begin, row_starts + end, owners)


def _runs(
    first: npt.NDArray[np.intp], last: npt.NDArray[np.intp], owners: npt.NDArray[np.intp]
) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Return all numbers from first to last of each owner, and the owner of each: 3, 4 of 0 and 8 of 1 -> [3, 4, 8]."""
    counts = np.maximum(0, last - first + 1)
    before = np.cumsum(counts) - counts
    return np.repeat(first - before, counts) + np.arange(int(counts.sum())), np.repeat(owners, counts)


def _shaded(surface: Surface, depth: Array, axes: Array) -> Array:
    """Return the color of each vertex in the light, (v, 3), from 0 to 255; both sides of a surface are lit."""
    normals = surface.normals @ axes.T
    normals *= np.where(normals[:, 2] < 0, np.float32(-1), np.float32(1))[:, None]
    light = 0.5 + 0.18 * normals[:, 1] + 0.42 * np.maximum(0, normals @ KEY_LIGHT)
    if surface.colors is None:
        shade = 0.6 * np.clip(0.5 - depth, 0, 1)[:, None]
        plain: Array = (light[:, None] * (NEAR + (FAR - NEAR) * shade)).astype(np.float32)
        return plain
    shine = 0.07 * np.maximum(0, normals @ SHINE_LIGHT) ** 12  # shows what is black, too
    lit: Array = (1.15 * light[:, None] * linear(surface.colors)).astype(np.float32)
    painted: Array = (255 * np.clip(_encoded(lit) + shine[:, None], 0, 1)).astype(np.float32)
    return painted


def _encoded(linear: Array) -> Array:
    """Return linear values as sRGB, from 0 to 1 (IEC 61966-2-1)."""
    encoded: Array = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    return encoded


def _ground(vertices: Array, side: int, axes: Array) -> Array:
    """Return the brightness of the ground at each pixel, (side * side,): white, with a soft shadow under the object."""
    right, up, toward = axes
    if toward[1] <= 0 or not len(vertices):  # seen from its side
        return np.full(side * side, GROUND, np.float32)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    across = (np.arange(side, dtype=np.float32) - (side - 1) / 2) * np.float32(EXTENT / side)
    above = -across[:, None]
    along = (low[1] - BELOW - above * up[1]) / toward[1]  # from the picture's plane to the ground
    x, z = (across * right[axis] + above * up[axis] + along * toward[axis] for axis in (0, 2))
    middle, reach = (low + high) / 2, SPREAD / 2 * np.maximum(high - low, 0.2)
    distance = np.hypot((x - middle[0]) / reach[0], (z - middle[2]) / reach[2])
    share = np.clip((1 - distance) / 0.9, 0, 1)
    fade = share * share * (3 - 2 * share)
    ground: Array = (GROUND * (1 - SHADOW * fade * fade)).astype(np.float32).ravel()
    return ground


def _edges(depth: Array) -> Array:
    """Return how bright each pixel is beside what lies before it, (h, w): the same for all samples of a pixel."""
    height, width = (side // SUPERSAMPLING for side in depth.shape)
    light = eye_dome(depth.reshape(height, SUPERSAMPLING, width, SUPERSAMPLING).max(axis=(1, 3)))
    return light.repeat(SUPERSAMPLING, axis=0).repeat(SUPERSAMPLING, axis=1)
