"""JSON: {"n": ..., "points": [[x, y, z], ...]}, with nine significant digits, which restore the same float32.

Colors, if any, follow the points in the same order: `"colors": [[red, green, blue], ...]`, 0 to 255.
"""

from typing import Final

from service.formats import text
from service.mapping.spec import Array, Colors

MAX_POINTS: Final = 100_000
SEPARATOR: Final = b","
COLORS: Final = b'],"colors":['


def head(n: int, bounds: tuple[Array, Array] | None = None) -> bytes:
    """Return the bytes before the points; JSON needs no bounds."""
    return b'{"n":%d,"points":[' % n


def body(points: Array) -> bytes:
    """Write points (m, 3) as m arrays, separated by commas."""
    return text.rows("[%.9g,%.9g,%.9g]", points, between=",")


def colors(rows: Colors) -> bytes:
    """Write colors (m, 3) as m arrays, separated by commas."""
    return text.rows("[%d,%d,%d]", rows, between=",")


def tail(n: int) -> bytes:
    """Return the bytes after the points."""
    return b"]}\n"
