"""PLY, binary little endian: three float32 a vertex, and red, green, blue where it has a colour."""

from service.formats import raw
from service.mapping.spec import Array, Colors

_HEADER = """\
ply
format binary_little_endian 1.0
comment +Y is up, the front faces +Z
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


def head(n: int, bounds: tuple[Array, Array] | None = None, *, colored: bool = False) -> bytes:
    """What precedes the points; PLY needs no bounds."""
    return _HEADER.format(n=n, color=COLOR if colored else "").encode("ascii")


def colored_body(points: Array, colors: Colors) -> bytes:
    """Points (m, 3) and their colours -> 15 m bytes."""
    return raw.beside(points, colors)


def length(n: int, *, colored: bool = False) -> int:
    """Bytes of the whole file."""
    return len(head(n, colored=colored)) + (15 if colored else 12) * n
