"""Divide polygons into triangles by clipping ears. A fan is right for convex polygons only."""

from typing import Final

import numpy as np
import numpy.typing as npt

REFLEX: Final = 1e-6  # least sine of a turn to the wrong side: less is rounding

Doubles = npt.NDArray[np.float64]
Corners = tuple[int, int, int]


def concave(polygons: Doubles) -> npt.NDArray[np.bool_]:
    """Return whether each polygon turns to the wrong side somewhere: (m, k, 3) -> (m,) bool."""
    following = np.roll(polygons, -1, axis=1)
    edges = following - polygons
    before = np.roll(edges, 1, axis=1)
    normals = _normals(polygons)
    turns = np.einsum("mkd,md->mk", np.cross(before, edges), normals)
    lengths = np.linalg.norm(before, axis=2) * np.linalg.norm(edges, axis=2)
    flags: npt.NDArray[np.bool_] = np.any(turns < -REFLEX * lengths * np.linalg.norm(normals, axis=1)[:, None], axis=1)
    return flags


def split_polygon(polygon: Doubles) -> list[Corners]:
    """Return the k - 2 triangles of a simple polygon, (k, 3), as numbers of its corners in the polygon's direction.

    A polygon without area becomes a fan. Where no ear is left (the polygon crosses itself), the sharpest corner goes.
    """
    normal = _normals(polygon[None])[0]
    length = float(np.linalg.norm(normal))
    if length == 0 or not np.isfinite(length):
        return [(0, number, number + 1) for number in range(1, len(polygon) - 1)]
    flat = _flatten(polygon, normal / length)
    left = list(range(len(polygon)))
    triangles: list[Corners] = []
    while len(left) > 3:
        ear = _ear(flat[left])
        triangles.append((left[ear - 1], left[ear], left[(ear + 1) % len(left)]))
        del left[ear]
    return [*triangles, (left[0], left[1], left[2])]


def _normals(polygons: Doubles) -> Doubles:
    """Return twice the area vectors (Newell): (m, k, 3) -> (m, 3)."""
    spokes = polygons - polygons.mean(axis=1, keepdims=True)
    normals: Doubles = np.cross(spokes, np.roll(spokes, -1, axis=1)).sum(axis=1)
    return normals


def _flatten(polygon: Doubles, normal: Doubles) -> Doubles:
    """Project along the unit normal, so that the polygon runs counterclockwise: (k, 3) -> (k, 2)."""
    across = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    across /= np.linalg.norm(across)
    flat: Doubles = (polygon - polygon.mean(axis=0)) @ np.stack([across, np.cross(normal, across)], axis=1)
    return flat


def _ear(points: Doubles) -> int:
    """Return the first convex corner whose triangle holds no other point, or else the sharpest corner."""
    before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
    turns = _cross(points - before, after - points)
    for number in np.flatnonzero(turns >= 0).tolist():
        a, b, c = before[number], points[number], after[number]
        inside = (
            np.minimum.reduce([_cross(b - a, points - a), _cross(c - b, points - b), _cross(a - c, points - c)]) >= 0
        )
        corner = ((points == a) | (points == b) | (points == c)).all(axis=1)
        if not (inside & ~corner).any():
            return int(number)
    return int(turns.argmax())


def _cross(a: Doubles, b: Doubles) -> Doubles:
    """Return the z component of the cross products of vectors in the plane, (..., 2)."""
    product: Doubles = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product
