"""NumPy's .npy: an (n, 3) array of little-endian float32, C order."""

import io

from numpy.lib import format as npy_format

from service.mapping.spec import Array


def head(n: int, bounds: tuple[Array, Array] | None = None) -> bytes:
    """Return the bytes before the points; .npy needs no bounds."""
    buffer = io.BytesIO()
    npy_format.write_array_header_1_0(buffer, {"descr": "<f4", "fortran_order": False, "shape": (n, 3)})
    return buffer.getvalue()


def length(n: int) -> int:
    """Return the size of the whole file in bytes."""
    return len(head(n)) + 12 * n
