"""Measure an object's box: a probe of fixed points, then a search around the outermost ones.

Most outermost points of an object are images of the canonical domain's border, so the probe is dense there. The
search then tries points around the best candidates of each of the six directions, in steps that become smaller.
The same function gives the same box on one machine with the same engine (the compiled kernel, or NumPy).
Other engines round sums differently, and the search may end at another point: boxes then differ by up to a thousandth
of the longest side. benchmarks/BOXES.md has the error against the box of many points.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

from service.errors import CorruptWeights
from service.mapping.canonical import canonical_points
from service.mapping.color import ColorSampler
from service.mapping.folding import coarse_word
from service.mapping.frame import Frame
from service.mapping.sampler import SCALES, Sampler
from service.mapping.spec import Array, Domain, Functions, MappingSpec, word_of

BORDER: Final = 4096  # probe points on the domain's border
INTERIOR: Final = 2048  # probe points anywhere in the domain
CANDIDATES: Final = 4  # for each of the six directions
TRIALS: Final = 16  # points around each candidate, in each step
STEPS: Final = (0.1, 0.05, 0.02, 0.01)  # radius of the search around a candidate
PROBE_POINTS: Final = BORDER + INTERIOR + 6 * CANDIDATES * TRIALS * len(STEPS)  # evaluated for one box

# A search goes from each candidate: (6 * CANDIDATES,), for the directions +x, +y, +z, -x, -y, -z in turn.
SEARCHES: Final = np.arange(6 * CANDIDATES)
AXES: Final = np.array([0, 1, 2, 0, 1, 2]).repeat(CANDIDATES)
SIGNS: Final = np.array([1, 1, 1, -1, -1, -1], np.float32).repeat(CANDIDATES)[:, None]
BLOCK: Final = 96  # probe points of which only the largest value is compared at first

Values = npt.NDArray[np.float32]


@np.errstate(over="ignore", invalid="ignore")  # checked at the end, once
def measure(spec: MappingSpec, theta: Array) -> Frame:
    """Measure the box of a function, or of a word, in its own numbers.

    Parameters
    ----------
    theta : (spec.size,) float32; for a word (spec.k, spec.size), the last row applied first.

    Raises
    ------
    CorruptWeights : the function's values exceed float32.
    """
    values_at = _word(spec, word_of(spec, theta))
    probe, around = _probe(spec.domain)
    values = values_at(probe)  # (3, n)
    best, reached = _outermost(np.concatenate([values, -values]))  # (6, candidates) each
    candidates, reached = probe[:, best.ravel()], reached.ravel()  # (d, searches), (searches,)
    for step in STEPS:
        trials = _inside(spec.domain, candidates[:, :, None] + np.float32(step) * around)  # (d, searches, trials)
        values = values_at(trials.reshape(len(trials), -1)).reshape(3, *trials.shape[1:])
        heights = SIGNS * values[AXES, SEARCHES]  # (searches, trials)
        top = heights.argmax(axis=1)
        higher = heights[SEARCHES, top]
        candidates = np.where(higher > reached, trials[:, SEARCHES, top], candidates)
        reached = np.maximum(reached, higher)
    outermost = reached.reshape(6, CANDIDATES).max(axis=1)
    if not np.isfinite(outermost).all():  # the largest of values is NaN if one of them is
        raise CorruptWeights("the mapping function's values exceed float32", field="theta")
    return Frame.of(-outermost[3:], outermost[:3])


def _word(spec: MappingSpec, word: Sequence[Array]) -> Callable[[Array], Array]:
    """Return the map of a word from canonical points to its values, (d, n) -> (3, n)."""
    sampler = Sampler(spec, word)  # checks the word
    if spec.is_one_relu_layer:
        return coarse_word(spec, word)
    return lambda x: sampler.map(x.T).T


def examine(spec: MappingSpec, functions: Functions) -> Frame:
    """Measure the box of a new object, and check that its points at the largest scale, and its colors, are finite.

    Raises
    ------
    CorruptWeights : a value exceeds float32.
    """
    frame = measure(spec, functions.theta)
    if max(map(abs, (*frame.low, *frame.high))) > np.finfo(np.float32).max / SCALES[1]:
        raise CorruptWeights("the mapping function's values exceed float32", field="theta")
    if functions.color:
        ColorSampler(functions.color).colors(PROBE_POINTS)  # the sampler raises
    return frame


def _outermost(heights: Values) -> tuple[npt.NDArray[np.intp], Values]:
    """Return the places of the CANDIDATES largest values of each row, (6, n), and the values.

    They lie in the blocks with the largest ones: few values are compared more than once.
    """
    rows, blocks = np.arange(6)[:, None], heights.reshape(6, -1, BLOCK)
    kept = blocks.max(axis=2).argpartition(-CANDIDATES, axis=1)[:, -CANDIDATES:]  # NaN counts as the largest
    within = blocks[rows, kept].reshape(6, -1)
    order = within.argpartition(-CANDIDATES, axis=1)[:, -CANDIDATES:]
    return kept[rows, order // BLOCK] * BLOCK + order % BLOCK, within[rows, order]


@lru_cache(maxsize=4)
def _probe(domain: Domain) -> tuple[Array, Array]:
    """Return the probe's canonical points, (d, m), and offsets for searches of radius 1, (d, 1, TRIALS)."""
    points = canonical_points(domain, BORDER + INTERIOR).T
    border = points[:, :BORDER]
    lengths = _lengths(domain, border)
    on_border = border / np.where(lengths > 0, lengths, 1)
    ball: Domain = "ball4" if len(points) == 4 else "ball"
    probe = np.concatenate([on_border, points[:, BORDER:]], axis=1).astype(np.float32)
    return probe, np.ascontiguousarray(canonical_points(ball, TRIALS, seed=1).T)[:, None]


def _inside(domain: Domain, x: Array) -> Array:
    """Move points that lie outside the domain to its border, and all points onto a sphere: (d, ...) float32."""
    if domain == "cube":
        return np.clip(x, -1, 1)
    lengths = _lengths(domain, x)
    limit = np.where(lengths > 0, lengths, 1) if domain == "sphere" else np.maximum(lengths, 1)
    return (x / limit).astype(np.float32, copy=False)


def _lengths(domain: Domain, x: Array) -> Array:
    """Return the length of each point in the norm whose unit ball is the domain: (d, ...) -> (...)."""
    lengths: Array = np.abs(x).max(axis=0) if domain == "cube" else np.sqrt((x * x).sum(axis=0))
    return lengths
