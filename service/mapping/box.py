"""Measure an object's box: a probe of fixed points, then a search around the outermost ones.

Most outermost points of an object are images of the canonical domain's border, so the probe is dense there. The
search then tries points around the best candidates of each of the six directions, in steps that become smaller.
The same function gives the same box on one machine with the same engine (the compiled kernel, or NumPy).
Other engines round sums differently, and the search may end at another point: boxes then differ by up to a thousandth
of the longest side. benchmarks/BOXES.md has the error against the box of many points.
"""

from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

from service.errors import CorruptWeights
from service.mapping.canonical import canonical_points
from service.mapping.color import ColorSampler
from service.mapping.frame import Frame
from service.mapping.sampler import SCALES, Sampler
from service.mapping.spec import Array, Domain, Functions, MappingSpec, word_of

BORDER: Final = 4096  # probe points on the domain's border
INTERIOR: Final = 2048  # probe points anywhere in the domain
CANDIDATES: Final = 4  # for each of the six directions
TRIALS: Final = 16  # points around each candidate, in each step
STEPS: Final = (0.1, 0.05, 0.02, 0.01)  # radius of the search around a candidate
PROBE_POINTS: Final = BORDER + INTERIOR + 6 * CANDIDATES * TRIALS * len(STEPS)  # evaluated for one box

AXES: Final = (0, 1, 2, 0, 1, 2)  # of the directions +x, +y, +z, -x, -y, -z
SIGNS: Final = np.array([1, 1, 1, -1, -1, -1], np.float32)[:, None, None]

Values = npt.NDArray[np.float32]


def measure(spec: MappingSpec, theta: Array) -> Frame:
    """Measure the box of a function, or of a word, in its own numbers.

    Parameters
    ----------
    theta : (spec.size,) float32; for a word (spec.k, spec.size), the last row applied first.

    Raises
    ------
    CorruptWeights : the function's values exceed float32.
    """
    sampler = Sampler(spec, word_of(spec, theta))
    probe, around = _probe(spec.domain)
    points = sampler.map(probe).T
    best, reached = _outermost(np.concatenate([points, -points]))  # (6, candidates) each
    candidates = probe[best]  # (6, candidates, d)
    for step in STEPS:
        trials = _inside(spec.domain, candidates[:, :, None] + np.float32(step) * around)  # (6, candidates, trials, d)
        values = sampler.map(trials.reshape(-1, spec.input_dim)).reshape(*trials.shape[:3], 3)
        heights = SIGNS * values[np.arange(6), :, :, AXES]  # (6, candidates, trials)
        top = heights.argmax(axis=2)[:, :, None]
        higher = np.take_along_axis(heights, top, axis=2)[:, :, 0]
        moved = np.take_along_axis(trials, top[:, :, :, None], axis=2)[:, :, 0]
        candidates = np.where((higher > reached)[:, :, None], moved, candidates)
        reached = np.maximum(reached, higher)
    outermost = reached.max(axis=1)
    return Frame.of(-outermost[3:], outermost[:3])


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
    """Return the places of the CANDIDATES largest values of each row, and the values; overwrite them with -inf."""
    rows = np.arange(len(heights))
    places, values = np.empty((len(heights), CANDIDATES), np.intp), np.empty((len(heights), CANDIDATES), np.float32)
    for rank in range(CANDIDATES):  # a fifth of the time of a sort
        places[:, rank] = heights.argmax(axis=1)
        values[:, rank] = heights[rows, places[:, rank]]
        heights[rows, places[:, rank]] = -np.inf
    return places, values


@lru_cache(maxsize=4)
def _probe(domain: Domain) -> tuple[Array, Array]:
    """Return the probe's canonical points, (m, d), and `TRIALS` offsets for a search of radius 1, (TRIALS, d)."""
    points = canonical_points(domain, BORDER + INTERIOR)
    border = points[:BORDER]
    lengths = _lengths(domain, border)
    on_border = border / np.where(lengths > 0, lengths, 1)
    ball: Domain = "ball4" if points.shape[1] == 4 else "ball"
    return np.concatenate([on_border, points[BORDER:]]).astype(np.float32), canonical_points(ball, TRIALS, seed=1)


def _inside(domain: Domain, x: Array) -> Array:
    """Move points that lie outside the domain to its border, and all points onto a sphere: (..., d) float32."""
    if domain == "cube":
        return np.clip(x, -1, 1)
    lengths = _lengths(domain, x)
    limit = np.where(lengths > 0, lengths, 1) if domain == "sphere" else np.maximum(lengths, 1)
    return (x / limit).astype(np.float32)


def _lengths(domain: Domain, x: Array) -> Array:
    """Return the length of each point in the norm whose unit ball is the domain: (..., d) -> (..., 1)."""
    lengths: Array = (
        np.abs(x).max(axis=-1, keepdims=True) if domain == "cube" else np.linalg.norm(x, axis=-1)[..., None]
    )
    return lengths
