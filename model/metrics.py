"""Every metric convention, named, and its bootstrap interval. Distances are in longest sides."""

from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

Floats = npt.NDArray[np.float32]

THRESHOLDS: Final = (0.01, 0.02, 0.05)
NAMES: Final = ("cd_forward", "cd_backward", "cd_sq", "f@1%", "f@2%", "f@5%")
RESAMPLES: Final = 10_000


def compare(predicted: Floats, true: Floats) -> dict[str, float]:
    """All metrics of one predicted cloud (n, 3) against the true one (m, 3).

    cd_forward, cd_backward : cd_epcg, the mean unsquared nearest distance predicted -> true and
        true -> predicted, x100 (what the paper's tables compare with).
    cd_sq : the mean squared nearest distance, the sum of both directions, x100 (paper, eq. 3).
    f@t : F-score, the harmonic mean of the shares of points within t of the other cloud.
    """
    forward: npt.NDArray[np.float64] = cKDTree(true).query(predicted)[0]
    backward: npt.NDArray[np.float64] = cKDTree(predicted).query(true)[0]
    figures = {
        "cd_forward": 100 * float(forward.mean()),
        "cd_backward": 100 * float(backward.mean()),
        "cd_sq": 100 * float(np.square(forward).mean() + np.square(backward).mean()),
    }
    for threshold in THRESHOLDS:
        precision, recall = float((forward <= threshold).mean()), float((backward <= threshold).mean())
        figures[f"f@{threshold:.0%}"] = 2 * precision * recall / (precision + recall) if precision + recall else 0.0
    return figures


def interval(values: npt.NDArray[np.float64], seed: int = 0) -> tuple[float, float, float]:
    """Mean of per-object values (n,) and its 95% bootstrap interval over objects: mean, low, high."""
    rng = np.random.default_rng(seed)
    means = values[rng.integers(len(values), size=(RESAMPLES, len(values)))].mean(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return float(values.mean()), float(low), float(high)
