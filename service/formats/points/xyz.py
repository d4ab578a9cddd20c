"""XYZ text: one point a line, six significant digits."""

from service.formats import text
from service.mapping.spec import Array


def head(n: int, bounds: tuple[Array, Array] | None = None) -> bytes:
    """What precedes the points: nothing."""
    return b""


def body(points: Array) -> bytes:
    """Points (m, 3) -> m lines."""
    return text.rows("%.6g %.6g %.6g\n", points)
