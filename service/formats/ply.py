"""PLY, binary little endian: three float32 a vertex."""

from service.mapping import Array

_HEADER = """\
ply
format binary_little_endian 1.0
comment +Y is up, the front faces +Z
element vertex {n}
property float x
property float y
property float z
end_header
"""


def head(n: int, bounds: tuple[Array, Array] | None = None) -> bytes:
    """What precedes the points; PLY needs no bounds."""
    return _HEADER.format(n=n).encode("ascii")


def length(n: int) -> int:
    """Bytes of the whole file."""
    return len(head(n)) + 12 * n
