"""Points of a part of an object -> the point encoder's input, normalized by themselves alone, as in training.

centered and scaled by their own box -> at most `count` of them, chosen at random -> repeated up to `count`, which the
encoder's maximum over points does not see -> (1, count, 3) float32.
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from service.errors import InvalidParameter
from service.mapping.spec import Array

LEAST_POINTS: Final = 64
MOST_POINTS: Final = 2_048  # that an encoder is trained with
LEAST_SIDE: Final = 1e-3  # of a part's box, in longest sides of the object: in training no part is smaller
CHOICE_SEED: Final = 0  # of the points that are chosen: the same points give the same object


@dataclass(frozen=True)
class PointInput:
    """A point encoder's input and its place in the sender's frame.

    tensor : (1, count, 3) float32, box centered at the origin, its longest side 1.
    center : of the points' box, in the sender's frame.
    scale : longest side of that box, in the sender's unit.
    count : number of points that were sent.
    """

    tensor: Array
    center: tuple[float, float, float]
    scale: float
    count: int


def normalize(points: npt.NDArray[np.floating[Any]], count: int) -> PointInput:
    """Turn points (n, 3) into the input of an encoder of `count` points.

    Raises
    ------
    InvalidParameter : fewer than LEAST_POINTS points, or all at one place.
    """
    if len(points) < LEAST_POINTS:
        raise InvalidParameter(f"there are {len(points)} points, at least {LEAST_POINTS} are needed", field="points")
    doubles = points.astype(np.float64)
    low, high = doubles.min(axis=0), doubles.max(axis=0)
    center, scale = low + (high - low) / 2, float((high - low).max())
    if scale == 0:
        raise InvalidParameter("all points are at the same place", field="points")
    unit = (doubles - center) / scale
    if len(unit) > count:
        unit = unit[np.random.default_rng(CHOICE_SEED).choice(len(unit), count, replace=False)]
    tensor = np.ascontiguousarray(np.resize(unit, (1, count, 3)), np.float32)
    x, y, z = map(float, center)
    return PointInput(tensor, (x, y, z), scale, len(points))
