"""Point Cloud Library's PCD 0.7, binary: three float32 per point, and `rgb` if points have colors.

`rgb` follows the library's convention: the bytes blue, green, red, 0, that is 0x00RRGGBB, declared as a float32.
"""

import numpy as np

from service.formats import raw
from service.mapping.spec import Array, Colors

_HEADER = """\
# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS x y z{rgb}
SIZE 4 4 4{size}
TYPE F F F{type}
COUNT 1 1 1{count}
WIDTH {n}
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS {n}
DATA binary
"""
_PLAIN = {"rgb": "", "size": "", "type": "", "count": ""}
_COLORED = {"rgb": " rgb", "size": " 4", "type": " F", "count": " 1"}


def head(n: int, bounds: tuple[Array, Array] | None = None, *, colored: bool = False) -> bytes:
    """Return the bytes before the points; PCD needs no bounds."""
    return _HEADER.format(n=n, **(_COLORED if colored else _PLAIN)).encode("ascii")


def colored_body(points: Array, colors: Colors) -> bytes:
    """Write points (m, 3), each followed by its color (m, 3), in 16 m bytes."""
    return raw.interleave(points, np.pad(colors[:, ::-1], ((0, 0), (0, 1))))


def length(n: int, *, colored: bool = False) -> int:
    """Return the size of the whole file in bytes."""
    return len(head(n, colored=colored)) + (16 if colored else 12) * n
