"""What training minimises: the symmetric Chamfer distance, and the projection regularisation."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import numpy.typing as npt
import torch
from scipy.spatial import cKDTree
from torch import Tensor


def nearest(queries: Tensor, targets: Tensor, threads: ThreadPoolExecutor) -> Tensor:
    """Index of each query's nearest target, per batch element: (b, n, 3), (b, m, 3) -> (b, n) int64."""
    pairs = list(zip(queries.detach().numpy(), targets.detach().numpy(), strict=True))

    def search(pair: tuple[npt.NDArray[np.float32], npt.NDArray[np.float32]]) -> npt.NDArray[np.int64]:
        found: npt.NDArray[np.int64] = cKDTree(pair[1], balanced_tree=False, compact_nodes=False).query(pair[0])[1]
        return found

    return torch.from_numpy(np.stack(list(threads.map(search, pairs))))


def chamfer(predicted: Tensor, true: Tensor, threads: ThreadPoolExecutor) -> Tensor:
    """CD(P, T) + CD(T, P) of the paper's eq. 3 (squared distances), mean over the batch.

    Parameters
    ----------
    predicted : (b, n, 3), carries gradients.
    true : (b, m, 3).
    """
    forward = _gather(true, nearest(predicted, true, threads)) - predicted  # (b, n, 3)
    backward = _gather(predicted, nearest(true, predicted, threads)) - true  # (b, m, 3)
    return forward.square().sum(-1).mean() + backward.square().sum(-1).mean()


def projection(predicted: Tensor, canonical: Tensor) -> Tensor:
    """Mean squared distance that points travel (paper, eq. 6): (b, n, 3) both -> scalar."""
    return (predicted - canonical).square().sum(-1).mean()


def _gather(points: Tensor, index: Tensor) -> Tensor:
    return points.gather(1, index.unsqueeze(-1).expand(-1, -1, 3))
