"""JSON: {"n": ..., "points": [[x, y, z], ...]}, nine significant digits, which give back the same float32.

Where points have colours, `"colors": [[red, green, blue], ...]` of 0 to 255 comes after them, in the same order.
"""

from typing import Final

from service.formats import text
from service.mapping.spec import Array, Colors

MAX_POINTS: Final = 100_000
SEPARATOR: Final = b","
COLORS: Final = b'],"colors":['


def head(n: int, bounds: tuple[Array, Array] | None = None) -> bytes:
    """What precedes the points; JSON needs no bounds."""
    return b'{"n":%d,"points":[' % n


def body(points: Array) -> bytes:
    """Points (m, 3) -> m arrays with commas between, none at the ends."""
    return text.rows("[%.9g,%.9g,%.9g]", points, between=",")


def colors(rows: Colors) -> bytes:
    """Colours (m, 3) -> m arrays with commas between, none at the ends."""
    return text.rows("[%d,%d,%d]", rows, between=",")


def tail(n: int) -> bytes:
    """What follows the points."""
    return b"]}\n"
