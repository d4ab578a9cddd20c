"""Positions of the cameras that render an object: a ring of fixed ones, and random ones."""

import math
from typing import Final

import numpy as np
import numpy.typing as npt

RING_VIEWS: Final = 24
RING_ELEVATION_DEG: Final = (15.0, 35.0)
RING_DISTANCE: Final = 3.0  # camera to object center, in longest sides: about a 20 degree lens
DISTANCE: Final = (1.3, 6.0)  # longest sides, uniform in the logarithm: wide to long lenses
ELEVATION_DEG: Final = (0.0, 45.0)
TRAIN_ELEVATION_DEG: Final = (-5.0, 55.0)
TRAIN_ROLL_DEG: Final = 2.0  # standard deviation; 0 in the other splits

Doubles = npt.NDArray[np.float64]


def ring_cameras(rng: np.random.Generator) -> Doubles:
    """Return cameras at even azimuths around an object, at random elevations.

    Returns
    -------
    (RING_VIEWS, 4) azimuth and elevation in degrees, distance in longest sides, roll in degrees. Azimuth 0 looks at
    the front.
    """
    azimuths = np.arange(RING_VIEWS) * (360 / RING_VIEWS)
    elevations = rng.uniform(*RING_ELEVATION_DEG, RING_VIEWS)
    return np.column_stack([azimuths, elevations, np.full(RING_VIEWS, RING_DISTANCE), np.zeros(RING_VIEWS)])


def free_cameras(views: int, train: bool, rng: np.random.Generator) -> Doubles:
    """Return random cameras, with wider elevations and some roll for the training split.

    Returns
    -------
    (views, 4) azimuth and elevation in degrees, distance in longest sides, roll in degrees.
    """
    azimuths = rng.uniform(0, 360, views)
    elevations = rng.uniform(*(TRAIN_ELEVATION_DEG if train else ELEVATION_DEG), views)
    distances = np.exp(rng.uniform(math.log(DISTANCE[0]), math.log(DISTANCE[1]), views))
    rolls = rng.normal(0, TRAIN_ROLL_DEG if train else 0, views)
    return np.stack([azimuths, elevations, distances, rolls], axis=1)
