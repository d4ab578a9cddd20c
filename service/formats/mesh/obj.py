"""Wavefront OBJ of a surface: positions and normals with six significant digits, triangles counted from 1.

A vertex's colour stands behind its position: red, green, blue in [0, 1], sRGB. The format has no such thing, but
MeshLab, Blender, three.js and trimesh read it, and what does not skips it.
"""

from typing import Final

import numpy as np

from service.formats import text
from service.mapping.surface import Surface

_HEADER: Final = b"# +Y is up, the front faces +Z\n"


def dump(surface: Surface) -> bytes:
    """The whole file."""
    vertex, vertices = "v %.6g %.6g %.6g\n", surface.vertices
    if surface.colors is not None:
        vertex = "v %.6g %.6g %.6g %.4g %.4g %.4g\n"
        vertices = np.concatenate([vertices, surface.colors / np.float32(255)], axis=1)
    corners = np.repeat(surface.triangles + 1, 2, axis=1)  # v//vn: both have the same number
    return b"".join(
        [
            _HEADER,
            text.rows(vertex, vertices),
            text.rows("vn %.6g %.6g %.6g\n", surface.normals),
            text.rows("f %d//%d %d//%d %d//%d\n", corners),
        ]
    )
