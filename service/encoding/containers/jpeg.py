"""JPEG: segments and scans. Comments and all application segments but JFIF's and Adobe's are dropped."""

import math
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from service.encoding.containers.container import MAX_METADATA_BYTES, MAX_PROFILE_BYTES, Container, check_count
from service.encoding.containers.exif import orientation_of
from service.errors import CorruptImage

MAX_SCANS: Final = 128  # encoders write 6 to 24, and try some 60
MARKER: Final = re.compile(rb"\xff([\x01-\xcf\xd8-\xfe])")  # not a stuffed byte, not a restart
START_OF_FRAME: Final = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
PROGRESSIVE: Final = frozenset({0xC2, 0xC6, 0xCA, 0xCE})
END, SCAN, COMMENT, CUT = 0xD9, 0xDA, 0xFE, -1
BARE: Final = frozenset({0x01, 0xD8, END})  # markers without a segment
EXIF, ICC = 0xE1, 0xE2
APPLICATION: Final = range(0xE0, 0xF0)
NEEDED: Final = {0xE0: (b"JFIF\0", 14), 0xEE: (b"Adobe", 12)}  # name and least size; they say how colors are coded
EXIF_NAME: Final = b"Exif\0\0"
XMP_NAME: Final = b"http://ns.adobe.com/xap/1.0/\0"
ICC_NAME: Final = b"ICC_PROFILE\0"
MAX_ICC_PARTS: Final = 255  # their number is a byte


@dataclass
class _Component:
    """A color component: its blocks of 8 x 8 samples, and the bits that each coefficient still lacks."""

    blocks: int
    lacking: bytearray = field(default_factory=lambda: bytearray(b"\xff" * 64))


class _Frame:
    """The frame header (ITU T.81, B.2.2), and what the scans read so far did for its components."""

    def __init__(self, marker: int, segment: bytes) -> None:
        try:
            _, height, width, count = struct.unpack_from(">BHHB", segment)
            fields = [struct.unpack_from(">BB", segment, 6 + 3 * index) for index in range(count)]
            across, down = max(each >> 4 for _, each in fields), max(each & 15 for _, each in fields)
            columns, rows = -(-width // (8 * across)), -(-height // (8 * down))
        except (struct.error, ValueError, ZeroDivisionError) as error:
            raise CorruptImage("the image is truncated or corrupt: its JPEG frame is", field="image") from error
        self.size = (width, height)
        self.components = {name: _Component(columns * rows * (each >> 4) * (each & 15)) for name, each in fields}
        self.is_buffered = marker in PROGRESSIVE
        self.scans = self.passes = 0

    def add_scan(self, segment: bytes) -> None:
        """Account for one scan header (B.2.3)."""
        self.scans += 1
        check_count(self.scans, "scans", MAX_SCANS)
        count = segment[0] if segment else 0
        names, tail = segment[1 : 1 + 2 * count : 2], segment[1 + 2 * count :]
        self.is_buffered |= count < len(self.components)
        for name in names:
            if name in self.components and len(tail) >= 3:
                component = self.components[name]
                self.passes += 64 * component.blocks
                first, last = tail[0], min(tail[1], 63)
                component.lacking[first : last + 1] = bytes([tail[2] & 15]) * (last + 1 - first)

    @property
    def buffered_bytes(self) -> int:
        """Memory for all coefficients, which files of several scans need."""
        return sum(128 * each.blocks for each in self.components.values()) if self.is_buffered else 0

    @property
    def is_complete(self) -> bool:
        """Return whether the scans bring every bit of every coefficient."""
        return self.scans > 0 and not any(any(each.lacking) for each in self.components.values())


@dataclass
class _Metadata:
    """The segments that say how the pixels are to be shown."""

    exif: bytearray = field(default_factory=bytearray)
    xmp: bytes = b""
    icc: list[bytes] = field(default_factory=list)

    def add(self, marker: int, segment: bytes) -> None:
        """Take over one application segment."""
        if marker == EXIF and segment.startswith(EXIF_NAME):
            if len(self.exif) < MAX_METADATA_BYTES:
                self.exif += segment[len(EXIF_NAME) :]  # one too long for a segment goes on in the next
        elif marker == EXIF and segment.startswith(XMP_NAME):
            self.xmp = segment
        elif marker == ICC and segment.startswith(ICC_NAME):
            self.icc.append(segment[len(ICC_NAME) :])

    @property
    def profile(self) -> bytes | None:
        """The ICC profile, joined in the order of its numbered parts; None if one is missing."""
        if not 0 < len(self.icc) <= MAX_ICC_PARTS:
            return None
        parts = sorted(self.icc)
        if [part[:1] for part in parts] != [bytes([number]) for number in range(1, len(parts) + 1)]:
            return None
        profile = b"".join(part[2:] for part in parts)
        is_whole = all(part[1:2] == bytes([len(parts)]) for part in parts)
        return profile if is_whole and 0 < len(profile) <= MAX_PROFILE_BYTES else None


class _Segment(NamedTuple):
    """A marker with its segment: `data[start:end]` with the marker, `content` without marker and length."""

    marker: int
    start: int
    end: int
    content: bytes


def read(data: bytes) -> Container:
    """Read the segments of a JPEG, up to its end marker. Raises CorruptImage, TooLarge."""
    kept, metadata, frames, begin, is_cut = [], _Metadata(), list[_Frame](), 0, True
    end = len(data.rstrip(b"\xff"))
    for segment in _segments(data, end):
        marker = segment.marker
        if marker == END:
            end, is_cut = segment.end, False
        elif marker == CUT:
            end = segment.start
        elif marker in START_OF_FRAME:
            if frames:
                raise CorruptImage("the image is truncated or corrupt: the JPEG has two frames", field="image")
            frames.append(_Frame(marker, segment.content))
        elif marker == SCAN and frames:
            frames[0].add_scan(segment.content)
        elif marker == COMMENT or (marker in APPLICATION and not _is_needed(segment)):
            metadata.add(marker, segment.content)
            kept.append(data[begin : segment.start])
            begin = segment.end
    if not frames or frames[0].scans == 0 or (is_cut and not frames[0].is_complete):
        raise CorruptImage("the image is truncated or corrupt: not all scans of the JPEG are there", field="image")
    return Container(
        b"".join((*kept, data[begin:end])),
        frames[0].size,
        orientation_of(bytes(metadata.exif), metadata.xmp),
        metadata.profile,
        buffered_bytes=frames[0].buffered_bytes,
        passes=frames[0].passes,
        copies=3 if is_cut else 1,  # compared, as `decode` says
        is_cut=is_cut,
    )


def _is_needed(segment: _Segment) -> bool:
    """Return whether an application segment decides how pixels are decoded."""
    name, size = NEEDED.get(segment.marker, (b"", math.inf))
    return segment.content.startswith(name) and len(segment.content) >= size


def _segments(data: bytes, end: int) -> Iterator[_Segment]:
    """Yield the segments in file order; the last one is the end marker, or has the marker CUT if it is cut off."""
    at = count = 0
    while match := MARKER.search(data, at, end):
        count += 1
        check_count(count, "segments")
        marker, start, at = match[1][0], match.start(), match.end()
        if marker not in BARE:
            at += max(2, int.from_bytes(data[at : at + 2], "big"))
        if at > end:
            yield _Segment(CUT, start, end, b"")
            return
        yield _Segment(marker, start, at, data[match.end() + 2 : at])
        if marker == END:
            return
