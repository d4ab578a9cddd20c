"""An object's surface: a triangulated canonical domain, pushed through the mapping function (paper, section 3.1).

f is continuous, so the image of a mesh is connected as the mesh is, and no points have to be joined by guess.
The sphere is one icosphere. A solid domain is filled with nested shells, which become layers of the object.
Where f moves parts of the object apart, it stretches the triangles between them: `service.mapping.tears` cuts them out.
A vertex is the image of a canonical point, and has the color of that point.
RESULTS.md compares this with grids, Poisson reconstruction and ball pivoting.
"""

import itertools
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

from service.mapping.color import ColorSampler
from service.mapping.pose import CAMERA_AXES, OBJECT_AXES, Pose
from service.mapping.sampler import Sampler
from service.mapping.spec import Array, Colors, Domain
from service.mapping.tears import Indices, Values, without_tears

RESOLUTION: Final = 64
RESOLUTIONS: Final = (8, 160)
SHELLS: Final[dict[Domain, int]] = {"sphere": 1, "ball": 24, "cube": 24, "ball4": 24}


@dataclass(frozen=True, eq=False)
class Surface:
    """A triangle mesh.

    vertices : (v, 3) float32, in the frame whose axes `axes` tells.
    triangles : (t, 3) uint32, three vertices each, counter-clockwise seen from outside.
    normals : (v, 3) float32, of length 1.
    colors : (v, 3) uint8, sRGB; None if the object has no color.
    axes : directions of the axes in words, for the heads of files.
    """

    vertices: Array
    triangles: Indices
    normals: Array
    colors: Colors | None = None
    axes: str = OBJECT_AXES

    def seen(self, pose: Pose, scale: float) -> "Surface":
        """Return the surface in a camera's frame; `scale` is that of its vertices."""
        vertices, normals = pose.place(self.vertices, scale), pose.turn(self.normals)
        return Surface(vertices, self.triangles, normals, self.colors, CAMERA_AXES)


def surface_of(
    sampler: Sampler, resolution: int = RESOLUTION, scale: float = 1.0, color: ColorSampler | None = None
) -> Surface:
    """Compute the surface of an object.

    Parameters
    ----------
    sampler : the object.
    resolution : the surface has 20 resolution^2 triangles before it is cut.
    scale : as in `Sampler.points`.
    color : colors of the vertices; None for a surface without colors.

    Raises
    ------
    CorruptWeights : a value of the function or of the color exceeds float32.
    """
    points, triangles = shells(sampler.domain, resolution)
    vertices = sampler.map(points, scale)
    cut, triangles = without_tears(points, vertices, triangles)
    points, vertices = np.concatenate([points, cut]), np.concatenate([vertices, sampler.map(cut, scale)])
    used, corners = np.unique(triangles, return_inverse=True)
    vertices, triangles = vertices[used], corners.reshape(-1, 3).astype(np.uint32)
    return Surface(vertices, triangles, _normals(vertices, triangles), color.map(points[used]) if color else None)


@lru_cache(maxsize=4)
def shells(domain: Domain, resolution: int) -> tuple[Array, Indices]:
    """Return closed meshes in a canonical domain: points (n, d) float32, and triangles (t, 3) facing outward.

    The sphere is one shell. In a ball or cube, each shell lies in the middle of an equal share of the volume; in the
    four-dimensional ball, each shell is a sphere in three of the dimensions.
    """
    count = SHELLS[domain]
    sphere, triangles = icosphere(max(1, round(resolution / math.sqrt(count))))
    if domain == "sphere":
        return sphere, triangles
    if domain == "cube":
        sphere /= np.abs(sphere).max(axis=1, keepdims=True)
    layers = []
    for index in range(count):
        layer = np.insert(sphere, index % 4, 0, axis=1) if domain == "ball4" else sphere
        layers.append(layer * np.float32(((index + 0.5) / count) ** (1 / layer.shape[1])))
    offsets = np.arange(count, dtype=np.uint32) * np.uint32(len(sphere))
    return np.concatenate(layers), (triangles + offsets[:, None, None]).reshape(-1, 3)


def icosphere(resolution: int) -> tuple[Array, Indices]:
    """Divide each edge of an icosahedron in r parts: a unit sphere of 20 r^2 triangles and 10 r^2 + 2 points."""
    corners, faces = _icosahedron()
    i, j = (part.ravel() for part in np.indices((resolution + 1, resolution + 1)))
    inside = i + j <= resolution
    weights = np.stack([i, j, resolution - i - j], axis=1)[inside]  # (m, 3)
    number = np.cumsum(inside) - 1  # number of lattice point (i, j), at i * row + j
    row = resolution + 1
    upward = np.flatnonzero(inside & (i + j < resolution))  # lattice points at which an upward triangle begins
    downward = np.flatnonzero(inside & (i + j < resolution - 1))  # those with a downward triangle beside it
    up = np.stack([upward, upward + row, upward + 1], axis=1)
    down = np.stack([downward + row, downward + row + 1, downward + 1], axis=1)
    lattice = number[np.concatenate([up, down])]  # (r^2, 3)
    points = (weights @ corners[faces]).reshape(-1, 3)  # (20 m, 3)
    # Faces share their borders. Different points are at least 2 apart, so one coordinate differs by more than 1.
    _, first, merged = np.unique(np.rint(points), axis=0, return_index=True, return_inverse=True)
    triangles = merged.ravel()[lattice + len(weights) * np.arange(20)[:, None, None]].reshape(-1, 3)
    sphere = points[first] / np.linalg.norm(points[first], axis=1, keepdims=True)
    return sphere.astype(np.float32), triangles.astype(np.uint32)


def cross_products(vertices: Array, triangles: Indices) -> Values:
    """Return the cross product of two edges of each triangle, (t, 3): its normal, twice its area long."""
    a, b, c = (vertices[corner].astype(np.float64) for corner in triangles.T)
    products: Values = np.cross(b - a, c - a)
    return products


def _icosahedron() -> tuple[npt.NDArray[np.float64], npt.NDArray[np.intp]]:
    """Return corners (12, 3) with edges of length 2, and faces (20, 3), counter-clockwise seen from outside."""
    golden = (1 + math.sqrt(5)) / 2
    signs = itertools.product((-1, 1), repeat=2)
    corners = np.array([np.roll((0, a, b * golden), shift) for a, b in signs for shift in range(3)])
    near = np.linalg.norm(corners[:, None] - corners, axis=2) < 2.1
    triples = itertools.combinations(range(12), 3)
    faces = np.array([face for face in triples if all(near[pair] for pair in itertools.combinations(face, 2))])
    inward = np.linalg.det(corners[faces]) < 0
    faces[inward] = faces[inward, ::-1]
    return corners, faces


def _normals(vertices: Array, triangles: Indices) -> Array:
    """Return each vertex's normal: the area-weighted mean of its triangles', or (0, 1, 0) where they cancel out."""
    products = cross_products(vertices, triangles)
    sums = [np.bincount(triangles.ravel(), np.repeat(part, 3), len(vertices)) for part in products.T]
    normals = np.stack(sums, axis=1)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(lengths > 0, normals / np.where(lengths > 0, lengths, 1), (0, 1, 0)).astype(np.float32)
