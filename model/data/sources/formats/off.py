"""OFF: concave polygons."""

import io
import re

import numpy as np
import trimesh

from model.data.sources.formats.assets import decode
from model.data.sources.formats.polygons import concave, split_polygon


def read_off(data: bytes) -> list[trimesh.Trimesh]:
    """Return the file's mesh."""
    text = divide_concave(decode(data))
    scene = trimesh.load_scene(io.BytesIO(text.encode()), file_type="off", process=False)
    return [part for part in scene.dump() if isinstance(part, trimesh.Trimesh)]


def divide_concave(text: str) -> str:
    """Return an OFF file's text with its concave polygons divided into triangles."""
    plain = re.sub(r"#.*", "", text)
    match = re.match(r"\s*(C?OFF)\s+(\d+)\s+(\d+)(?:\s+\d+)?\s*?\n", plain)
    if not match:
        return text  # trimesh says what is wrong
    vertices, faces = int(match[2]), int(match[3])
    lines = [line for line in plain[match.end() :].split("\n") if line.strip()]
    positions = np.array([line.split()[:3] for line in lines[:vertices]], np.float64)
    divided = []
    for line in lines[vertices : vertices + faces]:
        count, *rest = line.split()
        corners = [int(number) for number in rest[: int(count)]]
        shape = positions[corners]
        if len(corners) > 3 and concave(shape[None])[0]:
            divided += [f"3 {corners[a]} {corners[b]} {corners[c]}" for a, b, c in split_polygon(shape)]
        else:
            divided.append(line)
    return "\n".join([match[1], f"{vertices} {len(divided)} 0", *lines[:vertices], *divided, ""])
