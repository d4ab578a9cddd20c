"""The search for the outermost points of an object, from probe points on: by NumPy, or by the compiled kernel."""

from typing import Final, Protocol

import numpy as np
import numpy.typing as npt

from service.mapping import compiled
from service.mapping.compiled import Kernel
from service.mapping.spec import Array, Domain

CANDIDATES: Final = 4  # for each of the six directions

# A search goes from each candidate: (6 * CANDIDATES,), for the directions +x, +y, +z, -x, -y, -z in turn.
SEARCHES: Final = np.arange(6 * CANDIDATES)
AXES: Final = np.array([0, 1, 2, 0, 1, 2]).repeat(CANDIDATES)
SIGNS: Final = np.array([1, 1, 1, -1, -1, -1], np.float32).repeat(CANDIDATES)[:, None]
BLOCK: Final = 96  # probe points of which only the largest value is compared at first
DOMAINS: Final[dict[Domain, int]] = {"cube": 0, "ball": 1, "ball4": 1, "sphere": 2}  # numbers of the kernel

Values = npt.NDArray[np.float32]


class Search(Protocol):
    """Searches around the outermost points of a probe.

    Attributes
    ----------
    reached : (6 * CANDIDATES,), the heights of the outermost points so far, in the order of the directions.
    """

    reached: Values

    def spread(self, radius: float) -> Array:
        """Return canonical points around each candidate: (d, n)."""

    def climb(self, values: Values) -> None:
        """Move the candidates to the last points of `spread` that lie farther out; `values` are theirs, (3, n)."""


def search_from(domain: Domain, probe: Array, around: Array, values: Values) -> Search:
    """Return a search from a probe's outermost points.

    Parameters
    ----------
    probe, values : (d, m), canonical points; (3, m), where they lie in the object. m is a multiple of BLOCK.
    around : (d, trials), offsets of the trials of a search of radius 1.
    """
    kernel = compiled.load()
    if kernel is None:
        return NumpySearch(domain, probe, around, values)
    return KernelSearch(kernel, domain, probe, around, values)


class NumpySearch:
    """A search by NumPy."""

    def __init__(self, domain: Domain, probe: Array, around: Array, values: Values) -> None:
        self._domain, self._around = domain, around[:, None]  # (d, 1, trials)
        best, reached = _outermost(np.concatenate([values, -values]))  # (6, candidates) each
        self._candidates, self.reached = probe[:, best.ravel()], reached.ravel()  # (d, searches), (searches,)
        self._trials = self._candidates[:, :, None]

    def spread(self, radius: float) -> Array:
        """Return canonical points around each candidate (`Search.spread`)."""
        trials = self._candidates[:, :, None] + np.float32(radius) * self._around
        self._trials = inside(self._domain, trials)  # (d, searches, trials)
        return self._trials.reshape(len(trials), -1)

    def climb(self, values: Values) -> None:
        """Move the candidates (`Search.climb`)."""
        heights = SIGNS * values.reshape(3, *self._trials.shape[1:])[AXES, SEARCHES]  # (searches, trials)
        top = heights.argmax(axis=1)
        higher = heights[SEARCHES, top]
        self._candidates = np.where(higher > self.reached, self._trials[:, SEARCHES, top], self._candidates)
        self.reached = np.maximum(self.reached, higher)


class KernelSearch:
    """A search by the compiled kernel."""

    def __init__(self, kernel: Kernel, domain: Domain, probe: Array, around: Array, values: Values) -> None:
        self._kernel, self._domain, self._around = kernel, DOMAINS[domain], around
        places, heights = np.empty((6, CANDIDATES), np.int64), np.empty((6, CANDIDATES), np.float32)
        kernel.outermost(np.ascontiguousarray(values), places, heights)
        self._candidates, self.reached = probe.take(places.ravel(), axis=1), heights.ravel()
        self._trials = np.empty((len(probe), self.reached.size * around.shape[1]), np.float32)

    def spread(self, radius: float) -> Array:
        """Return canonical points around each candidate (`Search.spread`)."""
        self._kernel.spread(self._candidates, self._around, radius, self._domain, self._trials)
        return self._trials

    def climb(self, values: Values) -> None:
        """Move the candidates (`Search.climb`)."""
        self._kernel.climb(np.ascontiguousarray(values), self._trials, self._candidates, self.reached)


def _outermost(heights: Values) -> tuple[npt.NDArray[np.intp], Values]:
    """Return the places of the CANDIDATES largest values of each row, (6, n), and the values.

    They lie in the blocks with the largest ones: few values are compared more than once.
    """
    rows, blocks = np.arange(6)[:, None], heights.reshape(6, -1, BLOCK)
    kept = blocks.max(axis=2).argpartition(-CANDIDATES, axis=1)[:, -CANDIDATES:]  # NaN counts as the largest
    within = blocks[rows, kept].reshape(6, -1)
    order = within.argpartition(-CANDIDATES, axis=1)[:, -CANDIDATES:]
    return kept[rows, order // BLOCK] * BLOCK + order % BLOCK, within[rows, order]


def inside(domain: Domain, x: Array) -> Array:
    """Move points that lie outside the domain to its border, and all points onto a sphere: (d, ...) float32."""
    if domain == "cube":
        return np.clip(x, -1, 1)
    lengths = lengths_of(domain, x)
    limit = np.where(lengths > 0, lengths, 1) if domain == "sphere" else np.maximum(lengths, 1)
    return (x / limit).astype(np.float32, copy=False)


def lengths_of(domain: Domain, x: Array) -> Array:
    """Return the length of each point in the norm whose unit ball is the domain: (d, ...) -> (...)."""
    lengths: Array = np.abs(x).max(axis=0) if domain == "cube" else np.sqrt((x * x).sum(axis=0))
    return lengths
