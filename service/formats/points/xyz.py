"""XYZ text: one point per line, six significant digits."""

from service.formats import text
from service.mapping.spec import Array


def head(n: int, bounds: tuple[Array, Array] | None = None) -> bytes:
    """Return no bytes: nothing precedes the points."""
    return b""


def body(points: Array) -> bytes:
    """Write points (m, 3) as m lines."""
    return text.rows("%.6g %.6g %.6g\n", points)
