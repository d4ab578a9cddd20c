"""PLY, binary little endian: three float32 per vertex, and red, green, blue if points have colors."""

from service.formats import raw
from service.mapping.pose import CAMERA_AXES, OBJECT_AXES
from service.mapping.spec import Array, Colors

_HEADER = """\
ply
format binary_little_endian 1.0
comment {axes}
element vertex {n}
property float x
property float y
property float z
{color}end_header
"""
COLOR = """\
property uchar red
property uchar green
property uchar blue
"""


def head(n: int, bounds: tuple[Array, Array] | None = None, *, colored: bool = False, camera: bool = False) -> bytes:
    """Return the bytes before the points, which are in the frame of a camera or of the object; no bounds needed."""
    axes = CAMERA_AXES if camera else OBJECT_AXES
    return _HEADER.format(n=n, axes=axes, color=COLOR if colored else "").encode("ascii")


def colored_body(points: Array, colors: Colors) -> bytes:
    """Write points (m, 3), each followed by its color (m, 3), in 15 m bytes."""
    return raw.interleave(points, colors)


def length(n: int, *, colored: bool = False, camera: bool = False) -> int:
    """Return the size of the whole file in bytes."""
    return len(head(n, colored=colored, camera=camera)) + (15 if colored else 12) * n
