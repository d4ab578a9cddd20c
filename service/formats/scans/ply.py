"""PLY: the vertices, ASCII or binary; faces and other properties are left out."""

from typing import Final

import numpy as np

from service.errors import CorruptPoints
from service.formats.scans.limits import MAX_HEADER, Doubles
from service.formats.scans.text import numbers

TYPES: Final = {
    name: code for names, code in (
        (("char", "int8"), "i1"), (("uchar", "uint8"), "u1"), (("short", "int16"), "i2"), (("ushort", "uint16"), "u2"),
        (("int", "int32"), "i4"), (("uint", "uint32"), "u4"), (("float", "float32"), "f4"),
        (("double", "float64"), "f8"),
    ) for name in names
}  # fmt: skip
ORDERS: Final = {"binary_little_endian": "<", "binary_big_endian": ">"}
END: Final = b"end_header"


def read(data: bytes) -> Doubles:
    """Return the vertices, (n, 3) float64. Raises CorruptPoints."""
    end = data.find(END, 0, MAX_HEADER)
    start = data.find(b"\n", end) + 1
    if end < 0 or start == 0:
        raise CorruptPoints(f"the PLY file's header has no {END.decode()}", field="points")
    encoding, count, properties = _header(data[:end].decode("ascii", "replace"))
    names = [name for name, _ in properties]
    if not {"x", "y", "z"} <= set(names) or len(set(names)) < len(names):
        raise CorruptPoints("the PLY file's vertices need the properties x, y and z, once each", field="points")
    if encoding == "ascii":
        columns = tuple(names.index(name) for name in "xyz")
        return numbers(data[start:], columns, "PLY", rows=count)
    dtype = np.dtype([(name, ORDERS[encoding] + code) for name, code in properties])
    if len(data) - start < count * dtype.itemsize:
        raise CorruptPoints(f"the PLY file ends before its {count} vertices do", field="points")
    vertices = np.frombuffer(data, dtype, count, offset=start)
    return np.stack([vertices[name] for name in "xyz"], axis=1).astype(np.float64)


def _header(header: str) -> tuple[str, int, list[tuple[str, str]]]:
    """Return the encoding, the number of vertices, and the name and type of each property of a vertex."""
    encoding, count, properties, elements = "", 0, [], 0
    for line in header.splitlines():
        match line.split():
            case ["format", name, _] if name == "ascii" or name in ORDERS:
                encoding = name
            case ["element", "vertex", digits] if digits.isdecimal() and len(digits) < 12 and not elements:
                count, elements = int(digits), 1
            case ["element", *_]:
                elements += 1
            case ["property", kind, name] if elements == 1 and kind in TYPES:
                properties.append((name, TYPES[kind]))
            case ["property", *_] if elements == 1:
                raise CorruptPoints(
                    f"a vertex of the PLY file has a property of another type: {line[:60]}", field="points"
                )
    if not encoding or not properties:
        raise CorruptPoints("the PLY file's header needs a format and vertices as its first element", field="points")
    return encoding, count, properties
