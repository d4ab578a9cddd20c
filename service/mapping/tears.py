"""Cut a surface where f tears it: triangles that span a gap of the object, such as that between two legs, are left out.

The cut runs through triangles, along a smooth line: whole triangles would leave a saw's teeth.
"""

from typing import Final

import numpy as np
import numpy.typing as npt

from service.mapping.spec import Array

Indices = npt.NDArray[np.uint32]
Values = npt.NDArray[np.float64]

MOST_STRETCH: Final = 8.0  # growth of squared lengths, in medians of all triangles; chosen on the validation split
NEAR: Final = 0.1  # a cut passes no nearer to a vertex, in lengths of the edge: it would leave slivers
LEAST: Final = 1e-9  # stretch, in medians, that its logarithm distinguishes from none


def without_tears(points: Array, vertices: Array, triangles: Indices) -> tuple[Array, Indices]:
    """Cut a surface where its stretch exceeds MOST_STRETCH.

    Parameters
    ----------
    points : canonical points (n, d).
    vertices : their images (n, 3).
    triangles : a closed mesh (t, 3).

    Returns
    -------
    Further canonical points on cut edges (m, d), and triangles of all n + m points.
    """
    level = stretches(points, vertices, triangles) - np.log(MOST_STRETCH)
    is_kept = level <= 0
    count = is_kept[triangles].sum(axis=1)
    whole, split = triangles[count == 3], triangles[(count == 1) | (count == 2)]
    kept = is_kept[split]
    is_corner = kept.sum(axis=1) == 1  # one corner is kept, of the other triangles two
    lone = np.where(is_corner, kept.argmax(axis=1), kept.argmin(axis=1))  # corner on its own side of the cut
    a, b, c = np.take_along_axis(split, (lone[:, None] + np.arange(3)) % 3, axis=1).T
    first, second = np.sort([np.r_[a, a], np.r_[b, c]], axis=0).astype(np.int64)
    edges, numbers = np.unique(first * len(points) + second, return_inverse=True)
    ab, ac = (numbers.ravel() + len(points)).reshape(2, -1)
    first, second = np.divmod(edges, len(points))
    share = (level[first] / (level[first] - level[second])).clip(NEAR, 1 - NEAR)[:, None]
    fresh: Array = ((1 - share) * points[first] + share * points[second]).astype(np.float32)
    corners = np.stack([a, ab, ac], axis=1)[is_corner]
    rest = np.concatenate([np.stack([ab, b, c], axis=1)[~is_corner], np.stack([ab, c, ac], axis=1)[~is_corner]])
    return fresh, np.concatenate([whole, corners, rest]).astype(np.uint32)


def stretches(points: Array, vertices: Array, triangles: Indices) -> Values:
    """Return the logarithm of how much f stretches the triangles at each point, in medians of all triangles: (n,).

    It is smoothed once: half its own value, half the mean of its neighbors. Without a median it is 0 everywhere.
    """
    before, after = (_longest(each, triangles) for each in (points, vertices))
    median = float(np.median(after / before))
    if not median:
        return np.zeros(len(points))
    sums = [np.bincount(triangles.ravel(), np.repeat(each, 3), len(points)) for each in (before, after)]
    stretch = np.log(np.maximum(sums[1] / (median * sums[0]), LEAST))
    ends = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    around = np.bincount(ends[:, 0], stretch[ends[:, 1]], len(points)) / np.bincount(ends[:, 0], minlength=len(points))
    smooth: Values = (stretch + around) / 2
    return smooth


def _longest(points: Array, triangles: Indices) -> Values:
    """Return the squared length of each triangle's longest edge: (t,)."""
    corners = points[triangles].astype(np.float64)
    edges = corners - corners[:, [1, 2, 0]]
    longest: Values = np.einsum("tcd,tcd->tc", edges, edges).max(axis=1)
    return longest
