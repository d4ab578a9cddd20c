"""STL of a surface, binary: separate triangles, each with its own normal, without colors."""

import struct
from typing import Final

import numpy as np

from service.mapping.surface import Surface, cross_products

_HEADER: Final = "hof: {axes}"  # must not begin with "solid": that marks text files
_TRIANGLE: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])


def dump(surface: Surface) -> bytes:
    """Write the whole file: 84 bytes, then 50 per triangle."""
    normals = cross_products(surface.vertices, surface.triangles)
    records = np.zeros(len(surface.triangles), _TRIANGLE)
    records["normal"] = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(np.float64).tiny)
    records["corners"] = surface.vertices[surface.triangles]
    return struct.pack("<80sI", _HEADER.format(axes=surface.axes).encode("ascii"), len(records)) + records.tobytes()
