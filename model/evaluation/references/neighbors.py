"""Exact distance of a cloud to the nearest of many objects, without comparing most of them."""

from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

Floats = npt.NDArray[np.float32]

CELLS: Final = 32  # a side of a grid over the unit cube about the origin
ROUNDING: Final = 1e-5  # longest sides: the error that float32 may add to a bound


class Neighbors:
    """Index for the nearest object under Chamfer distance.

    The distance from x to an object changes by no more than x moves. So the mean distance of a cloud's points is at
    least that of the centers of their grid cells, less the mean offset from point to center. Distances at centers are
    computed in advance, so the bounds of all objects take one matrix product. Objects are then compared in order of
    their bounds, until a bound exceeds the best distance so far.

    Parameters
    ----------
    clouds : (objects, n, 3), object frame.
    """

    def __init__(self, clouds: Floats) -> None:
        self._clouds = clouds
        self._trees = [cKDTree(cloud) for cloud in clouds]
        self._centers = _centers()
        self._fields = np.stack([self._field(tree) for tree in self._trees])  # (objects, cells)
        shares, offsets = zip(*map(self._spread, clouds), strict=True)
        self._shares, self._offsets = np.stack(shares), np.array(offsets)  # (objects, cells), (objects,)

    def distance(self, cloud: Floats) -> float:
        """Return cd_epcg to the nearest object, both directions summed, in longest sides: (m, 3) -> scalar."""
        tree = cKDTree(cloud)
        share, offset = self._spread(cloud)
        forward = np.maximum(self._fields @ share - offset - ROUNDING, 0)  # bounds, (objects,)
        backward = np.maximum(self._shares @ self._field(tree) - self._offsets - ROUNDING, 0)
        best = np.inf
        for index in np.argsort(forward + backward):
            if forward[index] + backward[index] >= best:
                break
            forward_distance = float(self._trees[index].query(cloud)[0].mean())
            if forward_distance + backward[index] < best:
                best = min(best, forward_distance + float(tree.query(self._clouds[index])[0].mean()))
        return best

    def _field(self, tree: cKDTree) -> Floats:
        """Return the distance of each cell's center to a cloud, (cells,)."""
        field: Floats = tree.query(self._centers)[0].astype(np.float32)
        return field

    def _spread(self, cloud: Floats) -> tuple[Floats, float]:
        """Return the share of a cloud's points in each cell, and the mean offset from a point to its cell's center.

        Points outside the grid count to the nearest cell.
        """
        x, y, z = np.clip(np.floor((cloud.T + 0.5) * CELLS), 0, CELLS - 1).astype(int)
        cells = (x * CELLS + y) * CELLS + z
        share = np.bincount(cells, minlength=CELLS**3).astype(np.float32) / np.float32(len(cloud))
        return share, float(np.linalg.norm(cloud - self._centers[cells], axis=1).mean())


def _centers() -> Floats:
    """Return the centers of all cells, (CELLS^3, 3), the last coordinate fastest."""
    axis = (np.arange(CELLS) + 0.5) / CELLS - 0.5
    centers: Floats = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.float32)
    return centers
