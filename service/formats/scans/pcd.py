"""PCD of the Point Cloud Library, ASCII or binary; points that are NaN, as in organized clouds, are left out."""

from typing import Final

import numpy as np

from service.errors import CorruptPoints, UnsupportedMedia
from service.formats.scans.limits import MAX_HEADER, Doubles
from service.formats.scans.text import numbers

CODES: Final = {"F": "f", "I": "i", "U": "u"}
SIZES: Final = {"F": ("4", "8"), "I": ("1", "2", "4", "8"), "U": ("1", "2", "4", "8")}
MAX_COUNT: Final = 4_096  # numbers of one field of a point


def read(data: bytes) -> Doubles:
    """Return the points, (n, 3) float64. Raises CorruptPoints, or UnsupportedMedia for compressed ones."""
    at = data.find(b"\nDATA ", 0, MAX_HEADER)
    start = data.find(b"\n", at + 1) + 1
    if at < 0 or start == 0:
        raise CorruptPoints("the PCD file's header has no DATA", field="points")
    lines = (line.split() for line in data[:start].decode("ascii", "replace").splitlines())
    header = {line[0]: line[1:] for line in lines if line and not line[0].startswith("#")}
    fields, count = _fields(header)
    encoding = " ".join(header["DATA"])
    columns = np.cumsum([0, *(int(width) for _, _, width in fields)])
    names = [name for name, _, _ in fields]
    if encoding == "ascii":
        points = numbers(data[start:], tuple(int(columns[names.index(name)]) for name in "xyz"), "PCD", rows=count)
    elif encoding == "binary":
        dtype = np.dtype([(f"{at}", code, (width,)) for at, (_, code, width) in enumerate(fields)])
        if len(data) - start < count * dtype.itemsize:
            raise CorruptPoints(f"the PCD file ends before its {count} points do", field="points")
        records = np.frombuffer(data, dtype, count, offset=start)
        points = np.stack([records[f"{names.index(name)}"][:, 0] for name in "xyz"], axis=1).astype(np.float64)
    else:
        raise UnsupportedMedia(f"a PCD file of DATA {encoding[:30]} is not read: save it as binary", field="points")
    return points[~np.isnan(points).any(axis=1)]


def _fields(header: dict[str, list[str]]) -> tuple[list[tuple[str, str, int]], int]:
    """Return name, type and count of each field, and the number of points."""
    names, sizes, types = (header.get(key, []) for key in ("FIELDS", "SIZE", "TYPE"))
    counts = header.get("COUNT", ["1"] * len(names))
    number = header.get("POINTS", [""])[0]
    fits = len(names) == len(sizes) == len(types) == len(counts) and number.isdecimal() and len(number) < 12
    if not fits or not {"x", "y", "z"} <= set(names):
        raise CorruptPoints(
            "the PCD file's header needs FIELDS with x, y, z, their SIZE and TYPE, and POINTS", field="points"
        )
    fields = []
    for name, size, kind, count in zip(names, sizes, types, counts, strict=True):
        if size not in SIZES.get(kind, ()) or not count.isdecimal() or not 1 <= int(count[:6]) <= MAX_COUNT:
            raise CorruptPoints(f"the PCD field {name[:30]} has a faulty SIZE, TYPE or COUNT", field="points")
        fields.append((name, f"<{CODES[kind]}{size}", int(count[:6])))
    return fields, int(number)
