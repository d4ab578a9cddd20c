"""Point Cloud Library's PCD 0.7, binary: three float32 a point."""

from service.mapping import Array

_HEADER = """\
# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS x y z
SIZE 4 4 4
TYPE F F F
COUNT 1 1 1
WIDTH {n}
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS {n}
DATA binary
"""


def head(n: int, bounds: tuple[Array, Array] | None = None) -> bytes:
    """What precedes the points; PCD needs no bounds."""
    return _HEADER.format(n=n).encode("ascii")


def length(n: int) -> int:
    """Bytes of the whole file."""
    return len(head(n)) + 12 * n
