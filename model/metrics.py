"""Metrics of point clouds under named conventions, and bootstrap intervals. Distances are in longest sides."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

Floats = npt.NDArray[np.float32]
Values = npt.NDArray[np.float64]

THRESHOLDS: Final = (0.01, 0.02, 0.05)
NAMES: Final = ("cd_forward", "cd_backward", "cd_sq", "f@1%", "f@2%", "f@5%")
RESAMPLES: Final = 10_000
LEVEL: Final = (2.5, 97.5)  # percentiles of the resampled means: a 95% interval


def compare(predicted: Floats, true: Floats) -> dict[str, float]:
    """Return all metrics of a predicted cloud (n, 3) against the true one (m, 3), by name."""
    return summarize(nearest_distances(predicted, true), nearest_distances(true, predicted))


def summarize(forward: Values, backward: Values) -> dict[str, float]:
    """Return all metrics from the nearest distances predicted -> true (n,) and true -> predicted (m,).

    cd_forward, cd_backward : cd_epcg, the mean unsquared nearest distance predicted -> true and
        true -> predicted, x100 (what the paper's tables compare with).
    cd_sq : the mean squared nearest distance, the sum of both directions, x100 (paper, eq. 3).
    f@t : F-score, the harmonic mean of the shares of points within t of the other cloud.
    """
    figures = {
        "cd_forward": 100 * float(forward.mean()),
        "cd_backward": 100 * float(backward.mean()),
        "cd_sq": 100 * float(np.square(forward).mean() + np.square(backward).mean()),
    }
    for threshold in THRESHOLDS:
        precision, recall = float((forward <= threshold).mean()), float((backward <= threshold).mean())
        figures[f"f@{threshold:.0%}"] = 2 * precision * recall / (precision + recall) if precision + recall else 0.0
    return figures


def nearest_distances(queries: Floats, points: Floats) -> Values:
    """Return the distance of each query (n, 3) to the nearest of the points (m, 3): (n,)."""
    distances: Values = cKDTree(points, balanced_tree=False, compact_nodes=False).query(queries)[0]
    return distances


def floor(true: Floats) -> dict[str, float]:
    """Return the metrics of a fresh sample of the same surface against the true points (m, 3): the sampling floor.

    Each true point takes the place of a fresh one and is compared with all others.
    """
    distances: Values = cKDTree(true).query(true, k=2)[0][:, 1]
    return summarize(distances, distances)


def interval(values: Values, seed: int = 0) -> tuple[float, float, float]:
    """Return the mean of per-object values (n,) and its 95% bootstrap interval over objects: mean, low, high.

    For differences between two methods on the same objects, this is the paired interval.
    """
    rng = np.random.default_rng(seed)
    means = values[rng.integers(len(values), size=(RESAMPLES, len(values)))].mean(axis=1)
    low, high = np.percentile(means, LEVEL)
    return float(values.mean()), float(low), float(high)


def class_uniform(values: Values, classes: Sequence[str], seed: int = 0) -> tuple[float, float, float]:
    """Return the mean over classes of the class means of per-object values (n,), and its 95% bootstrap interval.

    Objects are resampled within their class. The mean of `interval` is class-weighted: a class counts by its share
    of the objects (paper, section 4.1: F1 and cw-F1).
    """
    rng = np.random.default_rng(seed)
    labels = np.array(classes)
    groups = [values[labels == name] for name in sorted(set(classes))]
    resampled = [group[rng.integers(len(group), size=(RESAMPLES, len(group)))].mean(axis=1) for group in groups]
    low, high = np.percentile(np.mean(resampled, axis=0), LEVEL)
    return float(np.mean([group.mean() for group in groups])), float(low), float(high)
