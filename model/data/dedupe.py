"""Find objects of the same shape: color variants, mirror images, turned copies."""

from collections.abc import Collection
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

Floats = npt.NDArray[np.float32]

COMPARED_POINTS: Final = 4_000  # of each cloud
EXTENT_TOLERANCE: Final = 0.03  # of the longest side; pairs whose boxes differ more are different
THRESHOLD: Final = 1.25  # times the distance between two samples of the same surface


def duplicates(clouds: dict[str, Floats], threshold: float = THRESHOLD, first: Collection[str] = ()) -> dict[str, str]:
    """Map each object that repeats an earlier one (by sorted id, those of `first` before others) to the one to keep.

    Those of `first` are known to be different: they are not compared with each other.

    Two objects are the same when the mean nearest distance between their clouds, the worse of both
    directions and the best over quarter turns about +Y and mirror images, is below `threshold` times
    the distance of two samples of one object.

    Parameters
    ----------
    clouds : id -> (n, 3) float32 points on the surface, object frame, n at least 2 * COMPARED_POINTS.
    """
    ids = sorted(clouds, key=lambda id_: (id_ not in first, id_))
    halves = {id_: (clouds[id_][:COMPARED_POINTS], clouds[id_][COMPARED_POINTS : 2 * COMPARED_POINTS]) for id_ in ids}
    trees = {id_: cKDTree(halves[id_][0]) for id_ in ids}
    floors = {id_: float(trees[id_].query(halves[id_][1])[0].mean()) for id_ in ids}
    boxes = {id_: np.ptp(clouds[id_], axis=0) for id_ in ids}
    kept: list[str] = []
    repeats: dict[str, str] = {}
    protected = set(first)
    for id_ in ids:
        for other in [] if id_ in protected else kept:
            limit = threshold * max(floors[id_], floors[other])
            if _same(halves[id_][1], boxes[id_], trees[other], halves[other][0], boxes[other], limit):
                repeats[id_] = other
                break
        else:
            kept.append(id_)
    return repeats


def _same(a: Floats, box_a: Floats, tree_b: cKDTree, b: Floats, box_b: Floats, limit: float) -> bool:
    for turn in range(4):
        box = box_a if turn % 2 == 0 else box_a[[2, 1, 0]]
        if np.abs(box - box_b).max() > EXTENT_TOLERANCE:
            continue
        for mirrored in (False, True):
            moved = _turn(a, turn, mirrored)
            if tree_b.query(moved[:200])[0].mean() > 2 * limit:
                continue  # far apart: 200 points are enough to see it
            if tree_b.query(moved)[0].mean() < limit and cKDTree(moved).query(b)[0].mean() < limit:
                return True
    return False


def _turn(points: Floats, turn: int, mirrored: bool) -> Floats:
    """Mirror x if `mirrored`, then make `turn` quarter turns about +Y."""
    x, y, z = points.T
    x = -x if mirrored else x
    for _ in range(turn):
        x, z = z, -x
    return np.stack([x, y, z], axis=1)
