"""Points of a part of an object -> the point encoder's input, normalized by themselves alone, as in training.

centered and scaled by their own box -> at most `count` of them, in random order -> repeated up to `count`, which the
encoder's maximum over points does not see -> (1, count, 3) float32.
"""

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from service.errors import InvalidParameter
from service.mapping.spec import Array

Doubles = npt.NDArray[np.float64]

LEAST_POINTS: Final = 64
MOST_POINTS: Final = 2_048  # that an encoder is trained with
LEAST_SIDE: Final = 1e-3  # of a part's box, in longest sides of the object: in training no part is smaller
CHOICE_SEED: Final = 0  # of the order, and so of the points that are chosen: the same points give the same object


@dataclass(frozen=True)
class PointInput:
    """A point encoder's input and its place in the sender's frame.

    tensor : (1, count, 3) float32, box centered at the origin, its longest side 1.
    center : of the points' box, in the sender's frame.
    scale : longest side of that box, in the sender's unit.
    count : number of points that were sent.
    turn : degrees about +Y by which the sender's points are turned; the tensor's are not.
    """

    tensor: Array
    center: tuple[float, float, float]
    scale: float
    count: int
    turn: float = 0.0

    def place(self, points: npt.NDArray[np.floating[Any]]) -> Doubles:
        """Return points (n, 3) of the tensor's frame in the sender's frame."""
        placed: Doubles = self.scale * points @ rotation(self.turn).T + np.array(self.center)
        return placed


def rotation(turn: float) -> Doubles:
    """Return the matrix (3, 3) that turns points about +Y by `turn` degrees."""
    cos, sin = math.cos(math.radians(turn)), math.sin(math.radians(turn))
    return np.array([[cos, 0, sin], [0, 1, 0], [-sin, 0, cos]])


def normalize(points: npt.NDArray[np.floating[Any]], count: int, turn: float = 0.0) -> PointInput:
    """Turn points (n, 3) into the input of an encoder of `count` points.

    Parameters
    ----------
    turn : degrees about +Y by which the points are taken to be turned: the input is turned back.

    Raises
    ------
    InvalidParameter : fewer than LEAST_POINTS points, or all at one place.
    """
    if len(points) < LEAST_POINTS:
        raise InvalidParameter(f"there are {len(points)} points, at least {LEAST_POINTS} are needed", field="points")
    doubles = points.astype(np.float64)
    if turn:
        doubles = doubles @ rotation(turn)
    low, high = doubles.min(axis=0), doubles.max(axis=0)
    center, scale = low + (high - low) / 2, float((high - low).max())
    if scale == 0:
        raise InvalidParameter("all points are at the same place", field="points")
    chosen = np.random.default_rng(CHOICE_SEED).permutation(len(doubles))[:count]
    unit = (doubles[chosen] - center) / scale
    tensor = np.ascontiguousarray(np.resize(unit, (1, count, 3)), np.float32)
    x, y, z = map(float, rotation(turn) @ center if turn else center)
    return PointInput(tensor, (x, y, z), scale, len(points), turn)
