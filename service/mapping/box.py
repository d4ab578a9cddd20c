"""Measure an object's box: a probe of fixed points, then a search around the outermost ones.

Most outermost points of an object are images of the canonical domain's border, so the probe is dense there. The
search then tries points around the best candidates of each of the six directions, in steps that become smaller.
The same function gives the same box on one machine with the same engine (the compiled kernel, or NumPy).
Other engines round sums differently, and the search may end at another point: boxes then differ by up to a thousandth
of the longest side. benchmarks/BOXES.md has the error against the box of many points.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Final

import numpy as np

from service.errors import CorruptWeights
from service.mapping import compiled
from service.mapping.canonical import canonical_points
from service.mapping.color import ColorSampler
from service.mapping.folding import MARGIN, CompiledFold, Engine, Fold, NumpyFold, pack_distinct, through
from service.mapping.frame import Frame
from service.mapping.outermost import CANDIDATES, lengths_of, search_from
from service.mapping.sampler import SCALES, Sampler
from service.mapping.spec import Array, Domain, Functions, MappingSpec, word_of

BORDER: Final = 4096  # probe points on the domain's border
INTERIOR: Final = 2048  # probe points anywhere in the domain
TRIALS: Final = 16  # points around each candidate, in each step
STEPS: Final = (0.1, 0.05, 0.02, 0.01)  # radius of the search around a candidate
COARSE: Final = 3  # cells per side for some thousand points: more take longer to cut than they save
PROBE_POINTS: Final = BORDER + INTERIOR + 6 * CANDIDATES * TRIALS * len(STEPS)  # evaluated for one box


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
    search = search_from(spec.domain, probe, around, values)
    for step in STEPS:
        search.climb(values_at(search.spread(step)))
    outermost = search.reached.reshape(6, CANDIDATES).max(axis=1)
    if not np.isfinite(outermost).all():  # the largest of values is NaN if one of them is
        raise CorruptWeights("the mapping function's values exceed float32", field="theta")
    return Frame.of(-outermost[3:], outermost[:3])


def _word(spec: MappingSpec, word: Sequence[Array]) -> Callable[[Array], Array]:
    """Return the map of a word from canonical points to its values, (d, n) -> (3, n)."""
    sampler = Sampler(spec, word)  # checks the word
    if spec.is_one_relu_layer:
        return _coarse_word(spec, word)
    return lambda x: sampler.map(x.T).T


def _coarse_word(spec: MappingSpec, word: Sequence[Array]) -> Callable[[Array], Array]:
    """Return the map of a word, (3, n) float32 -> (3, n), cut coarsely: for some thousand points at any places.

    All functions are cut over the canonical domain's box, so one that the word repeats is cut once. Outside of the box
    the networks are whole.
    """
    high, kernel = np.full(3, 1 + MARGIN), compiled.load()

    def cut(theta: Array) -> Engine:
        fold = Fold(spec, theta, -high, high, COARSE, kernel)
        return CompiledFold(fold, kernel) if kernel else NumpyFold(fold)

    return partial(through, pack_distinct(cut, word[::-1]))


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


@lru_cache(maxsize=4)
def _probe(domain: Domain) -> tuple[Array, Array]:
    """Return the probe's canonical points, (d, m), and offsets for searches of radius 1, (d, TRIALS)."""
    points = canonical_points(domain, BORDER + INTERIOR).T
    border = points[:, :BORDER]
    lengths = lengths_of(domain, border)
    on_border = border / np.where(lengths > 0, lengths, 1)
    ball: Domain = "ball4" if len(points) == 4 else "ball"
    probe = np.concatenate([on_border, points[:, BORDER:]], axis=1).astype(np.float32)
    return probe, np.ascontiguousarray(canonical_points(ball, TRIALS, seed=1).T)
