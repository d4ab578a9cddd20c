"""WebP: RIFF chunks. Kept are those that decide pixels, of an animation those of the first frame."""

import struct
from typing import Final

from service.encoding.containers.container import MAX_PROFILE_BYTES, Container, check_count
from service.encoding.containers.exif import orientation_of
from service.errors import CorruptImage

METADATA: Final = {b"ICCP": 0x20, b"EXIF": 0x08, b"XMP ": 0x04}  # chunk -> its flag in VP8X
STILL: Final = (b"ALPH", b"VP8 ", b"VP8L")
NO_HEADER: Final = "the image is truncated or corrupt: it has no WebP header"


def read(data: bytes) -> Container:
    """Read the chunks of a WebP. Raises CorruptImage, TooLarge."""
    if len(data) < 30:
        raise CorruptImage(NO_HEADER, field="image")
    kept, metadata, frames, count = [], dict.fromkeys(METADATA, b""), 0, 0
    at, end_of_file = 12, min(len(data), 8 + int.from_bytes(data[4:8], "little"))
    while at + 8 <= end_of_file:
        count += 1
        check_count(count, "chunks")
        kind, length = data[at : at + 4], int.from_bytes(data[at + 4 : at + 8], "little")
        end = at + 8 + length + length % 2
        if kind in METADATA:
            metadata[kind] = metadata[kind] or data[at + 8 : at + 8 + length]
        elif kind == b"ANMF":
            frames += 1
            if frames == 1:
                kept.append(data[at:end])
        elif kind == b"VP8X":
            flags = data[at + 8] & ~sum(METADATA.values()) if at + 8 < len(data) else 0
            kept.append(data[at : at + 8] + bytes([flags]) + data[at + 9 : end])
        elif kind in STILL or kind == b"ANIM":
            kept.append(data[at:end])
        at = end
    body = b"".join((b"WEBP", *kept))
    profile = metadata[b"ICCP"]
    return Container(
        b"RIFF" + struct.pack("<I", len(body)) + body,
        _size(body),
        orientation_of(metadata[b"EXIF"], metadata[b"XMP "]),
        profile if 0 < len(profile) <= MAX_PROFILE_BYTES else None,
        copies=3,  # libwebp's two canvases, and the frame
    )


def _size(body: bytes) -> tuple[int, int]:
    """Return the size of the canvas, from the first chunk. Raises CorruptImage."""
    kind = body[4:8]
    if kind == b"VP8X" and len(body) >= 22:
        return int.from_bytes(body[16:19], "little") + 1, int.from_bytes(body[19:22], "little") + 1
    if kind == b"VP8L" and len(body) >= 17 and body[12] == 0x2F:
        (bits,) = struct.unpack_from("<I", body, 13)
        return (bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1
    if kind == b"VP8 " and len(body) >= 22 and body[15:18] == b"\x9d\x01\x2a":
        width, height = struct.unpack_from("<HH", body, 18)
        return width & 0x3FFF, height & 0x3FFF
    raise CorruptImage(NO_HEADER, field="image")
