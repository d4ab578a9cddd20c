"""The result of reading a container, and the bounds that all types share."""

import zlib
from dataclasses import dataclass
from typing import Final

from service.errors import TooLarge

MAX_PARTS: Final = 65_536  # chunks, segments or boxes of a file; a PNG of 20 MB in chunks of 8 KB has 2,500
MAX_PROFILE_BYTES: Final = 4 * 2**20  # of an ICC profile; the largest in common use, for CMYK, have 2.5 MB
MAX_METADATA_BYTES: Final = 2**20  # unpacked, of a text that may hold an orientation

ColorKey = tuple[int, ...]


@dataclass(frozen=True)
class Container:
    """An image file without its metadata.

    Attributes
    ----------
    data : a file of the same type that holds the pixels alone; of an animation, the first frame.
    size : (width, height) that the header announces, pixels, before the image is turned upright.
    orientation : EXIF's, 1 to 8; 1 if there is none or it cannot be read.
    profile : ICC profile; None if there is none or it is damaged.
    color_key : PNG's transparent gray or RGB value, at the file's own depth; None if there is none.
    depth : bits of a sample.
    buffered_bytes : memory that the decoder takes besides: JPEG's coefficients, AVIF's planes.
    passes : samples that the decoder visits for each scan, summed over the scans of a JPEG; else 0.
    copies : of the picture in RGB or RGBA, that decoding makes at a time.
    is_cut : a JPEG that lacks its end marker, although no scan is missing.
    """

    data: bytes
    size: tuple[int, int]
    orientation: int = 1
    profile: bytes | None = None
    color_key: ColorKey | None = None
    depth: int = 8
    buffered_bytes: int = 0
    passes: int = 0
    copies: int = 1
    is_cut: bool = False


def check_count(count: int, parts: str, limit: int = MAX_PARTS) -> None:
    """Raise TooLarge for more parts than the limit; `parts` is their name in the message."""
    if count > limit:
        raise TooLarge(f"the image file has more than {limit} {parts}, the limit: save it anew", field="image")


def unpack(data: bytes, limit: int) -> bytes | None:
    """Return what zlib packed; None if it is damaged, or longer than a limit in bytes."""
    stream = zlib.decompressobj()
    try:
        result = stream.decompress(data, limit)
    except zlib.error:
        return None
    return None if stream.unconsumed_tail else result
