"""PNG: chunks. Kept are those that decide pixels: IHDR, PLTE, tRNS of palettes, and IDAT."""

import re
import struct
from typing import Final

from service.encoding.containers.container import (
    MAX_METADATA_BYTES,
    MAX_PROFILE_BYTES,
    ColorKey,
    Container,
    check_count,
    unpack,
)
from service.encoding.containers.exif import orientation_of
from service.errors import CorruptImage

SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
END: Final = b"\0\0\0\0IEND\xaeB`\x82"
PALETTE: Final = 3  # color type
KEY_VALUES: Final = {0: 1, 2: 3}  # color type -> numbers of a transparent value: gray, RGB
TEXT: Final = (b"tEXt", b"zTXt", b"iTXt")
XMP_KEY: Final = b"XML:com.adobe.xmp"
EXIF_KEY: Final = b"Raw profile type exif"
HEX_EXIF: Final = re.compile(rb"\s*exif\s+\d+\s+([0-9a-fA-F\s]*)")  # as ImageMagick writes it


def read(data: bytes) -> Container:
    """Read the chunks of a PNG. Raises CorruptImage, TooLarge."""
    header, kept, metadata = b"", [], _Metadata()
    transparency: bytes | None = None
    at, count = len(SIGNATURE), 0
    while at + 8 <= len(data):
        count += 1
        check_count(count, "chunks")
        length, kind = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        begin, end = at + 8, min(at + 8 + length, len(data))
        if kind == b"IHDR" and not header:
            header = data[begin:end]
            kept.append(data[at : end + 4])
        elif kind == b"IDAT":
            kept.append(struct.pack(">I", end - begin) + data[at + 4 : end] + b"\0\0\0\0")  # Pillow reads no sum here
        elif kind == b"PLTE" or (kind == b"tRNS" and header[9:10] == bytes([PALETTE])):
            kept.append(data[at : end + 4])
        elif kind == b"tRNS":
            transparency = data[begin:end]
        elif kind == b"IEND":
            break
        else:
            metadata.add(kind, data[begin:end])
        at = end + 4
    if len(header) < 13:
        raise CorruptImage("the image is truncated or corrupt: it has no PNG header", field="image")
    width, height, depth, color = struct.unpack_from(">IIBB", header)
    kinds = [chunk[4:8] for chunk in kept]
    if color == PALETTE and b"PLTE" not in kinds[: kinds.index(b"IDAT") if b"IDAT" in kinds else None]:
        raise CorruptImage("the image is truncated or corrupt: it has no palette before its pixels", field="image")
    return Container(
        b"".join((SIGNATURE, *kept, END)),
        (width, height),
        orientation_of(metadata.exif, metadata.xmp),
        metadata.profile,
        _color_key(transparency, color, depth),
        depth,
    )


class _Metadata:
    """The chunks that say how the pixels are to be shown. The first of each kind counts; damaged ones are ignored.

    A chunk is unpacked when its value is read, so a thousand of a kind take no longer than one.
    """

    def __init__(self) -> None:
        self._first: dict[bytes, tuple[bytes, bytes]] = {}  # type, or keyword of a text -> type and content

    def add(self, kind: bytes, data: bytes) -> None:
        """Take over one chunk."""
        if kind in (b"eXIf", b"iCCP"):
            self._first.setdefault(kind, (kind, data))
        elif kind in TEXT:
            key, _, rest = data.partition(b"\0")
            if key in (XMP_KEY, EXIF_KEY):
                self._first.setdefault(key, (kind, rest))

    @property
    def exif(self) -> bytes:
        """EXIF as a chunk, else as ImageMagick's text; empty if there is none."""
        _, data = self._first.get(b"eXIf", (b"", b""))
        match = None if data else HEX_EXIF.match(self._text(EXIF_KEY))
        if match:
            digits = b"".join(match[1].split())
            data = bytes.fromhex(digits[: len(digits) // 2 * 2].decode("ascii"))
        return data

    @property
    def xmp(self) -> bytes:
        """XMP; empty if there is none."""
        return self._text(XMP_KEY)

    @property
    def profile(self) -> bytes | None:
        """The ICC profile; None if there is none."""
        _, data = self._first.get(b"iCCP", (b"", b""))
        packed = data.partition(b"\0")[2]  # after the name; a byte says how it is packed: 0, by zlib
        return unpack(packed[1:], MAX_PROFILE_BYTES) if packed[:1] == b"\0" else None

    def _text(self, key: bytes) -> bytes:
        return _text(*self._first[key]) if key in self._first else b""


def _text(kind: bytes, rest: bytes) -> bytes:
    """Return the text of a chunk of some kind, after its keyword; empty if it is damaged or too long."""
    if kind == b"tEXt":
        return rest[:MAX_METADATA_BYTES]
    is_packed = True
    if kind == b"iTXt":
        is_packed = rest[:1] == b"\1"
        rest = b"\0" + rest[2:].partition(b"\0")[2].partition(b"\0")[2]  # after language and translated keyword
    return (unpack(rest[1:], MAX_METADATA_BYTES) or b"") if is_packed else rest[1 : MAX_METADATA_BYTES + 1]


def _color_key(transparency: bytes | None, color: int, depth: int) -> ColorKey | None:
    """Return the transparent value of a gray or RGB image; None if there is none. Bits above the depth are ignored."""
    count = KEY_VALUES.get(color, 0)
    if transparency is None or count == 0 or len(transparency) < 2 * count:
        return None
    return tuple(value & (2**depth - 1) for value in struct.unpack_from(f">{count}H", transparency))
