"""Calls for collision-free paths around an object."""

import json
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from hof_client.answers import PlannedPath
from hof_client.bodies import Whole, json_reader
from hof_client.request import Call, Request

Point = Sequence[float] | NDArray[np.floating[Any]]  # x, y, z
PathFormat = Literal["json", "glb"]
PathFrame = Literal["object", "raw"]


def path(
    object_id: str,
    start: Point,
    goal: Point,
    *,
    cells: int = 32,
    clearance: float = 0.0,
    scale: float = 1.0,
    frame: PathFrame = "object",
) -> Call[PlannedPath]:
    """Plan a path around an object; if there is none, the answer's `path` is None, and `reason` says why.

    Parameters
    ----------
    start, goal : x, y, z, each at most `scale` from the middle of the object.
    cells : cells along each side of the cube that is planned in, 8 to 64.
    clearance : smallest distance from the object's points, in the unit of `scale`.
    scale : length of the longest side of the whole object's box, for example in meters.
    frame : `object`, or `raw` for the function's own numbers times `scale`.

    Raises
    ------
    NotFound, InvalidParameter : see `hof_client.problems`.
    """
    return Call(_request(object_id, "json", start, goal, cells, clearance, scale, frame), json_reader(PlannedPath))


def path_file(
    object_id: str,
    start: Point,
    goal: Point,
    *,
    format: PathFormat = "glb",  # noqa: A002 - the name in the API
    cells: int = 32,
    clearance: float = 0.0,
    scale: float = 1.0,
    frame: PathFrame = "object",
) -> Call[bytes]:
    """Return the file of a path; `glb` has it as lines, and raises InvalidParameter if there is none. See `path`."""
    return Call(
        _request(object_id, format, start, goal, cells, clearance, scale, frame, media_type=""), lambda _: Whole(bytes)
    )


def _request(
    object_id: str,
    format_: PathFormat,
    start: Point,
    goal: Point,
    cells: int,
    clearance: float,
    scale: float,
    frame: PathFrame,
    media_type: str = "application/json",
) -> Request:
    ends = {"start": [float(each) for each in start], "goal": [float(each) for each in goal]}
    body = {**ends, "cells": cells, "clearance": clearance, "scale": scale, "frame": frame}
    return Request(
        "POST",
        "/objects/{id}/path",
        {"id": object_id},
        {"format": format_},
        content=json.dumps(body).encode(),
        headers={"Content-Type": "application/json"},
        media_type=media_type,
    )
