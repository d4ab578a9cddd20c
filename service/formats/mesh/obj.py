"""Wavefront OBJ of a surface: positions and normals with six significant digits, triangles counted from 1.

A vertex's color follows its position: red, green, blue in [0, 1], sRGB. That is an extension of the format, which
MeshLab, Blender, three.js and trimesh read and other programs skip.
"""

import numpy as np

from service.formats import text
from service.mapping.surface import Surface


def dump(surface: Surface) -> bytes:
    """Write the whole file."""
    vertex, vertices = "v %.6g %.6g %.6g\n", surface.vertices
    if surface.colors is not None:
        vertex = "v %.6g %.6g %.6g %.4g %.4g %.4g\n"
        vertices = np.concatenate([vertices, surface.colors / np.float32(255)], axis=1)
    corners = np.repeat(surface.triangles + 1, 2, axis=1)  # v//vn: a vertex and its normal have the same number
    return b"".join(
        [
            f"# {surface.axes}\n".encode("ascii"),
            text.rows(vertex, vertices),
            text.rows("vn %.6g %.6g %.6g\n", surface.normals),
            text.rows("f %d//%d %d//%d %d//%d\n", corners),
        ]
    )
