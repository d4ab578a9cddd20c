"""The orientation of a photo, from EXIF or XMP that may be damaged anywhere else."""

import re
import struct
from typing import Final

ORIENTATION: Final = 0x0112
TYPES: Final = {1: "B", 3: "H", 4: "I"}  # of an integer field: byte, short, long
XMP_ORIENTATION: Final = re.compile(rb"""tiff:Orientation(?:\s*=\s*["']|>)\s*([1-8])""")


def orientation_of(exif: bytes, xmp: bytes = b"") -> int:
    """Return the orientation, 1 to 8: EXIF's if it has one, else XMP's, else 1.

    Only this field of the first directory is read, so that damage to any other field has no effect.
    """
    match = XMP_ORIENTATION.search(xmp)
    return _field(exif.removeprefix(b"Exif\0\0")) or (int(match[1]) if match else 1)


def _field(tiff: bytes) -> int | None:
    """Return the orientation in a TIFF file; None if there is none, or its value is not 1 to 8."""
    order = {b"II": "<", b"MM": ">"}.get(tiff[:2])
    if order is None:
        return None
    try:
        (start,) = struct.unpack_from(f"{order}I", tiff, 4)
        (count,) = struct.unpack_from(f"{order}H", tiff, start)
        for at in range(start + 2, start + 2 + 12 * count, 12):
            tag, kind = struct.unpack_from(f"{order}HH", tiff, at)
            if tag == ORIENTATION:
                (value,) = struct.unpack_from(order + TYPES[kind], tiff, at + 8)
                return value if 1 <= value <= 8 else None
    except (struct.error, KeyError):
        pass
    return None
