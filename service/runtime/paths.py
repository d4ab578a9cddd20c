"""Plan the path around an object that options ask for, in their frame and scale."""

import numpy as np

from service.errors import InvalidParameter
from service.mapping.frame import Frame
from service.mapping.sampler import Sampler
from service.mapping.spec import Functions, MappingSpec, word_of
from service.planning.grid import HALF, Floats, Grid
from service.planning.path import Path, plan, points_for
from service.runtime.cost import check_cost, cost_of
from service.runtime.options import PathOptions

ROUNDING = 1e-6  # longest sides: a point on a side of the cube may come out that far outside


def path_cost(spec: MappingSpec, options: PathOptions, max_points: int) -> int:
    """Return the work of a path: the object's points, and each cell like a point. Raises InvalidParameter."""
    n, cost = points_for(options.cells), cost_of(spec)
    check_cost(n, cost, max_points, "cells")
    return n * cost + options.cells**3


def path_of(spec: MappingSpec, functions: Functions, frame: Frame, options: PathOptions) -> Path:
    """Plan a path around an object, in the frame and scale of the options.

    Raises
    ------
    InvalidParameter : start or goal lies outside the cube.
    CorruptWeights : the values of the functions exceed float32.
    """
    center, unit = np.zeros(3), options.scale  # of the cube: 0 and 1 of the object frame
    if options.frame == "raw":
        center, unit = frame.center.astype(np.float64) * options.scale, frame.unit * options.scale
    start, goal = (_place(options, name, center, unit) for name in ("start", "goal"))
    points = Sampler(spec, word_of(spec, functions.theta), frame).points(points_for(options.cells), sampling="sobol")
    path = plan(Grid.of(points, options.cells, options.clearance / unit), start, goal)
    if path.waypoints is None:
        return path
    between = path.waypoints[1:-1] * unit + center
    return Path(np.concatenate([[options.start], between, [options.goal]]))


def _place(options: PathOptions, name: str, center: Floats, unit: float) -> list[float]:
    """Return start or goal in the object frame, longest side 1. Raises InvalidParameter if it is outside the cube."""
    point = getattr(options, name)
    placed = (np.array(point) - center) / unit
    if np.abs(placed).max() > HALF + ROUNDING:
        low, high = (", ".join(f"{value:g}" for value in center + sign * HALF * unit) for sign in (-1, 1))
        shown = ", ".join(f"{value:g}" for value in point)
        detail = f"{name} is [{shown}], it must lie between [{low}] and [{high}]: paths are planned in this cube"
        raise InvalidParameter(detail, field=name)
    inside: list[float] = np.clip(placed, -HALF, HALF).tolist()
    return inside
