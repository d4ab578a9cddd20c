"""The file formats of paths: JSON, and GLB with the path as a line."""

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from service.errors import InvalidParameter
from service.formats import raw
from service.formats.points import gltf
from service.planning.path import Path


@dataclass(frozen=True)
class PathFormat:
    """A file format for paths.

    name : value of the query parameter `format`.
    media_type : value of Content-Type and Accept.
    extension : of the file's name, with its dot.
    dump : path -> the whole file.
    """

    name: str
    media_type: str
    extension: str
    dump: Callable[[Path], bytes]


def dump_json(path: Path) -> bytes:
    """Write {"path": [[x, y, z], ...], "length": ..., "straight": ..., "reason": ...}; null stands for none."""
    fields = {
        "path": None if path.waypoints is None else path.waypoints.tolist(),
        "length": path.length,
        "straight": path.is_straight,
        "reason": path.reason,
    }
    return json.dumps(fields, separators=(",", ":")).encode("ascii") + b"\n"


def dump_glb(path: Path) -> bytes:
    """Write the path as one line for each pair of waypoints. Raises InvalidParameter if there is no path.

    A single line strip would be smaller, but some programs cannot read one (trimesh 4).
    """
    if path.waypoints is None:
        field = "start" if path.reason == "start inside" else "goal"
        raise InvalidParameter(f"there is no path ({path.reason}), and GLB holds no empty line: use json", field=field)
    points = path.waypoints.astype(np.float32).repeat(2, axis=0)[1:-1]  # both ends of each line
    bounds = points.min(axis=0), points.max(axis=0)
    return gltf.head(len(points), bounds, mode=gltf.LINES) + raw.float32(points)


PATH_FORMATS: Final[Mapping[str, PathFormat]] = {
    fmt.name: fmt
    for fmt in (
        PathFormat("json", "application/json", ".json", dump_json),
        PathFormat("glb", "model/gltf-binary", ".glb", dump_glb),
    )
}
