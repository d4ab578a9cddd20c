"""PLY of a surface, binary little endian.

Six float32 per vertex, and red, green, blue if vertices have colors; three indices per triangle.
"""

from typing import Final

import numpy as np

from service.formats import raw
from service.formats.points import ply
from service.mapping.surface import Surface

_HEADER: Final = """\
ply
format binary_little_endian 1.0
comment {axes}
element vertex {vertices}
property float x
property float y
property float z
property float nx
property float ny
property float nz
{color}element face {triangles}
property list uchar uint vertex_indices
end_header
"""
_FACE: Final = np.dtype([("count", "u1"), ("corners", "<u4", 3)])


def dump(surface: Surface) -> bytes:
    """Write the whole file."""
    faces = np.empty(len(surface.triangles), _FACE)
    faces["count"], faces["corners"] = 3, surface.triangles
    numbers = np.concatenate([surface.vertices, surface.normals], axis=1)
    color, vertices = "", raw.float32(numbers)
    if surface.colors is not None:
        color, vertices = ply.COLOR, raw.interleave(numbers, surface.colors)
    header = _HEADER.format(axes=surface.axes, vertices=len(numbers), color=color, triangles=len(faces))
    return header.encode("ascii") + vertices + faces.tobytes()
