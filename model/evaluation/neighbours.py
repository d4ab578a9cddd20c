"""The distance of a cloud to the nearest of many objects: exact, though most are never compared."""

from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

Floats = npt.NDArray[np.float32]

CELLS: Final = 32  # a side of a grid over the unit cube about the origin
ROUNDING: Final = 1e-5  # longest sides: what float32 may add to a bound


class Neighbours:
    """Objects to be near to.

    The distance from x to an object changes by no more than x moves. So the mean distance of a cloud's points is at
    least that of the centres of their grid cells, less the mean way from point to centre. Distances at centres are
    known in advance, which makes bounds for all objects one product of matrices; then objects are compared in order
    of their bounds, until a bound exceeds the best distance found.

    Parameters
    ----------
    clouds : (objects, n, 3), object frame.
    """

    def __init__(self, clouds: Floats) -> None:
        self._clouds = clouds
        self._trees = [cKDTree(cloud) for cloud in clouds]
        self._centres = _centres()
        self._fields = np.stack([self._field(tree) for tree in self._trees])  # (objects, cells)
        shares, ways = zip(*map(self._spread, clouds), strict=True)
        self._shares, self._ways = np.stack(shares), np.array(ways)  # (objects, cells), (objects,)

    def distance(self, cloud: Floats) -> float:
        """cd_epcg to the nearest object, both directions summed, longest sides: (m, 3) -> scalar."""
        tree = cKDTree(cloud)
        share, way = self._spread(cloud)
        forward = np.maximum(self._fields @ share - way - ROUNDING, 0)  # bounds, (objects,)
        backward = np.maximum(self._shares @ self._field(tree) - self._ways - ROUNDING, 0)
        best = np.inf
        for index in np.argsort(forward + backward):
            if forward[index] + backward[index] >= best:
                break
            there = float(self._trees[index].query(cloud)[0].mean())
            if there + backward[index] < best:
                best = min(best, there + float(tree.query(self._clouds[index])[0].mean()))
        return best

    def _field(self, tree: cKDTree) -> Floats:
        """Distance of each cell's centre to a cloud, (cells,)."""
        field: Floats = tree.query(self._centres)[0].astype(np.float32)
        return field

    def _spread(self, cloud: Floats) -> tuple[Floats, float]:
        """The share of a cloud's points in each cell (those outside count to the nearest), and the mean way from a
        point to its cell's centre."""
        x, y, z = np.clip(np.floor((cloud.T + 0.5) * CELLS), 0, CELLS - 1).astype(int)
        cells = (x * CELLS + y) * CELLS + z
        share = np.bincount(cells, minlength=CELLS**3).astype(np.float32) / np.float32(len(cloud))
        return share, float(np.linalg.norm(cloud - self._centres[cells], axis=1).mean())


def _centres() -> Floats:
    """(CELLS^3, 3), the last coordinate fastest."""
    axis = (np.arange(CELLS) + 0.5) / CELLS - 0.5
    centres: Floats = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3).astype(np.float32)
    return centres
