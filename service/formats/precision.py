"""Weights in fewer bytes: float16, or int8 with one scale for each matrix and each vector of a function.

An int8 number q stands for q * scale; the scale is the largest magnitude of its matrix or vector, divided by 127.
"""

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt

from service.errors import CorruptWeights, InvalidParameter
from service.mapping.canonical import canonical_points
from service.mapping.frame import Frame
from service.mapping.sampler import Sampler
from service.mapping.spec import Array, MappingSpec, word_of

Dtype = Literal["float32", "float16", "int8"]

LEVELS: Final = 127
LOSS_POINTS: Final = 2048


@dataclass(frozen=True)
class Loss:
    """Distances that points move because weights are stored in fewer bytes, in longest sides of the object.

    mean, largest : over `LOSS_POINTS` canonical points.
    """

    mean: float
    largest: float


def scales_of(spec: MappingSpec) -> int:
    """Return the number of scales of one function: a matrix and a vector for each layer."""
    return 2 * len(spec.shapes)


def to_float16(weights: Array) -> npt.NDArray[np.float16]:
    """Round to float16. Raises InvalidParameter if a number is beyond its range."""
    largest = float(np.finfo(np.float16).max)
    if np.abs(weights).max() > largest:
        raise InvalidParameter(
            f"the weights have numbers beyond {largest:g}, float16's largest: use float32", field="dtype"
        )
    return weights.astype(np.float16)


def to_int8(spec: MappingSpec, weights: Array) -> tuple[npt.NDArray[np.int8], Array]:
    """Round to int8: (..., spec.size) -> the numbers, of the same shape, and their scales (..., scales_of(spec))."""
    parts = [weights[..., part] for part in _parts(spec)]
    scales = np.stack([np.abs(part).max(axis=-1) / np.float32(LEVELS) for part in parts], axis=-1)
    divisors = np.where(scales > 0, scales, np.float32(1))
    numbers = [np.rint(part / divisors[..., at, None]) for at, part in enumerate(parts)]
    return np.clip(np.concatenate(numbers, axis=-1), -LEVELS, LEVELS).astype(np.int8), scales


def from_int8(spec: MappingSpec, numbers: npt.NDArray[np.int8], scales: Array) -> Array:
    """Return the float32 weights that int8 numbers stand for.

    Raises
    ------
    CorruptWeights : a scale is negative or not finite, or a weight exceeds float32.
    """
    if not (np.isfinite(scales).all() and (scales >= 0).all()):
        raise CorruptWeights("a scale of int8 weights is negative or not finite")
    with np.errstate(over="ignore"):
        parts = [numbers[..., part] * scales[..., at, None] for at, part in enumerate(_parts(spec))]
    weights: Array = np.concatenate(parts, axis=-1, dtype=np.float32)
    if not np.isfinite(weights).all():
        raise CorruptWeights("int8 weights exceed float32")
    return weights


def loss_of(spec: MappingSpec, theta: Array, restored: Array, frame: Frame) -> Loss:
    """Measure how far points move if theta is replaced by what was restored from fewer bytes.

    Raises
    ------
    CorruptWeights : the values of a function exceed float32.
    """
    exact, moved = (probe_points(spec, each) for each in (theta, restored))
    distances = np.linalg.norm(moved - exact, axis=1) / frame.unit
    return Loss(float(distances.mean()), float(distances.max()))


def probe_points(spec: MappingSpec, theta: Array) -> npt.NDArray[np.float64]:
    """Return the points of a function, or of a word, whose movement is measured: (LOSS_POINTS, 3)."""
    x = canonical_points(spec.domain, LOSS_POINTS)
    return Sampler(spec, word_of(spec, theta)).map(x).astype(np.float64)


def _parts(spec: MappingSpec) -> list[slice]:
    """Return where each matrix and each vector lies in theta, in order."""
    sizes = [size for n_out, n_in in spec.shapes for size in (n_out * n_in, n_out)]
    ends = np.cumsum(sizes).tolist()
    return [slice(end - size, end) for size, end in zip(sizes, ends, strict=True)]
