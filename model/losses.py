"""What training minimises: the symmetric Chamfer distance, late and early, and the projection regularisation."""

from typing import Final

import numba
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

TILE: Final = 512  # queries: their coordinates and bests stay in the L1 cache
FAR: Final = np.float32(1e30)  # fastmath knows no infinity
SATURATION: Final = 0.02  # longest sides: where a distance stops to matter to the F-score-like term
F_WEIGHT: Final = 0.1  # of that term; its slope at distance 0 is F_WEIGHT / SATURATION
TINY: Final = 1e-12  # squared longest sides: keeps the root's gradient finite at distance 0

Array = npt.NDArray[np.float32]
Indices = npt.NDArray[np.int64]


def nearest(queries: Tensor, targets: Tensor) -> Tensor:
    """Index of each query's nearest target, per batch element: (b, n, 3), (b, m, 3) -> (b, n) int64.

    Every distance is computed: at the sizes of training this takes a quarter to a half of a k-d tree's time.
    """
    pairs = (each.detach().transpose(1, 2).contiguous().numpy() for each in (queries, targets))
    found = torch.empty(queries.shape[:2], dtype=torch.int64)
    for each in zip(*pairs, found.numpy(), strict=True):
        _search(*each)
    return found


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _search(queries: Array, targets: Array, found: Indices) -> None:  # pragma: no cover - compiled
    """Queries (3, n) and targets (3, m) -> found (n,); queries are the vector's lanes."""
    best, index = np.empty(TILE, np.float32), np.empty(TILE, np.int32)
    for start in range(0, found.size, TILE):
        x, y, z = (queries[0, start : start + TILE], queries[1, start : start + TILE], queries[2, start : start + TILE])
        best[:] = FAR
        index[:] = 0
        for target in range(np.int32(targets.shape[1])):
            tx, ty, tz = targets[0, target], targets[1, target], targets[2, target]
            for p in range(x.size):
                dx, dy, dz = x[p] - tx, y[p] - ty, z[p] - tz
                squared = dx * dx + dy * dy + dz * dz
                closer = squared < best[p]
                best[p] = squared if closer else best[p]
                index[p] = np.int32(target) if closer else index[p]
        for p in range(x.size):
            found[start + p] = index[p]


def chamfer(predicted: Tensor, true: Tensor) -> Tensor:
    """CD(P, T) + CD(T, P) of the paper's eq. 3 (squared distances), mean over the batch.

    Parameters
    ----------
    predicted : (b, n, 3), carries gradients.
    true : (b, m, 3).
    """
    forward, backward = _squared_distances(predicted, true)
    return forward.mean() + backward.mean()


def late_chamfer(predicted: Tensor, true: Tensor) -> Tensor:
    """Mean of d + F_WEIGHT (1 - exp(-d / SATURATION)) over both directions' nearest distances d, summed.

    The first term is cd_epcg. The second acts as a smooth F-score: it rewards points that come close
    and lets go of those that are far. Shapes as in `chamfer`.
    """
    loss = predicted.new_zeros(())
    for squared in _squared_distances(predicted, true):
        distance = (squared + TINY).sqrt()
        loss = loss + (distance + F_WEIGHT * (1 - (-distance / SATURATION).exp())).mean()
    return loss


def projection(predicted: Tensor, canonical: Tensor) -> Tensor:
    """Mean squared distance that points travel (paper, eq. 6): (b, n, 3) both -> scalar."""
    return (predicted - canonical).square().sum(-1).mean()


def _squared_distances(predicted: Tensor, true: Tensor) -> tuple[Tensor, Tensor]:
    """Squared distance of each point to its nearest of the other cloud: (b, n) of predicted, (b, m) of true."""
    forward = gather(true, nearest(predicted, true)) - predicted
    backward = gather(predicted, nearest(true, predicted)) - true
    return forward.square().sum(-1), backward.square().sum(-1)


def gather(points: Tensor, index: Tensor) -> Tensor:
    """What a point's index stands for, per batch element: (b, m, 3), (b, n) int64 -> (b, n, 3)."""
    return points.gather(1, index.unsqueeze(-1).expand(-1, -1, 3))
