"""The object that points are a part of. Where its front lies is not known, so several sides are tried.

For each turn about +Y the points are turned back and encoded. The object whose points lie nearest to those of the part
is taken, fitted to the part (`service.mapping.refinement`), and lies in its place, turned.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from service.encoding.clouds import PointInput, normalize
from service.encoding.encoder import Encoded, Encoder
from service.mapping.refinement import STEPS, refine
from service.mapping.sampler import Sampler
from service.mapping.spec import Array, MappingSpec, word_of

TURNS: Final = tuple(45.0 * number for number in range(8))  # degrees; the first is as sent
IMAGES: Final = 32  # that take as long as completing an object
ADVANTAGE: Final = 0.95  # of the distance as sent, below which another turn is taken: so noise turns nothing
PART_POINTS: Final = 512  # that are compared
OBJECT_POINTS: Final = 2_048


def turned_inputs(points: npt.NDArray[np.floating[Any]], count: int) -> list[PointInput]:
    """Return the input of an encoder of `count` points for each turn. Raises as `normalize` does."""
    return [normalize(points, count, turn) for turn in TURNS]


def best_fit(spec: MappingSpec, inputs: Sequence[PointInput], encoded: Sequence[Encoded]) -> int:
    """Return the index of the object nearest to its part; 0, as sent, unless another one is clearly nearer.

    Raises
    ------
    CorruptWeights : the values of a function exceed float32.
    """
    distances = [_distance(spec, sent, each.theta) for sent, each in zip(inputs, encoded, strict=True)]
    best = int(np.argmin(distances))
    return best if distances[best] < ADVANTAGE * distances[0] else 0


def choose(
    spec: MappingSpec, inputs: Sequence[PointInput], encoded: Sequence[Encoded], steps: int = STEPS
) -> tuple[PointInput, Encoded]:
    """Return the input whose object fits best, and the object's functions, fitted to it in `steps`. Raises as above."""
    best = best_fit(spec, inputs, encoded)
    sent, functions = inputs[best], encoded[best]
    return sent, replace(functions, theta=refine(spec, functions.theta, sent.tensor[0], steps))


def complete(encoder: Encoder, points: npt.NDArray[np.floating[Any]], steps: int = STEPS) -> tuple[PointInput, Encoded]:
    """Return the object that points (n, 3) are a part of, as `choose` does.

    Raises
    ------
    InvalidParameter, CorruptWeights : as of `normalize` and `best_fit`.
    """
    inputs = turned_inputs(points, encoder.count or 0)
    encoded = encoder.encode(np.concatenate([sent.tensor for sent in inputs]))
    return choose(encoder.spec, inputs, encoded, steps)


def _distance(spec: MappingSpec, sent: PointInput, theta: Array) -> float:
    """Return the mean distance of the part's points to the nearest of the object's, in the sender's unit."""
    part = sent.tensor[0, :PART_POINTS]
    points = Sampler(spec, word_of(spec, theta)).points(OBJECT_POINTS)
    squared = (part**2).sum(axis=1)[:, None] + (points**2).sum(axis=1) - 2 * part @ points.T
    return float(np.sqrt(squared.min(axis=1).clip(0)).mean()) * sent.scale
