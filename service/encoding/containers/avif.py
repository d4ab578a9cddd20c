"""AVIF: EXIF is hidden from the decoder, and sizes are read from the AV1 data.

libavif reads the size of the picture from a box and notices only after decoding that the AV1 data hold a larger one.
"""

from typing import Final

from service.encoding.containers.boxes import MAX_ITEMS, items
from service.encoding.containers.container import Container, check_count
from service.errors import CorruptImage

BRANDS: Final = frozenset({b"avif", b"avis"})
SEQUENCE_HEADER: Final = 1  # OBU type (AV1 specification, 6.2.2)
MAX_UNITS: Final = 256  # of one picture: sequence header, frame, groups of tiles
HEAD_BITS: Final = 2_048  # of a sequence header; those before the size take at most 1,600 with 32 operating points
SAMPLES: Final = {0: 1.5, 1: 3, 2: 3}  # for each pixel, by profile: 4:2:0, 4:4:4, any
DAMAGED: Final = "the image is truncated or corrupt: its AV1 data are"

Picture = tuple[int, int, int]  # width, height, bytes of its planes


def read(data: bytes) -> Container:
    """Read the items of an AVIF. Raises CorruptImage, TooLarge.

    `size` is that of the largest AV1 picture; of a picture in tiles, that of a tile. `data` is a file without EXIF,
    which libavif's own rotation overrules, and which shows the still picture even if it has a sequence, too.
    """
    hidden, headers, is_tiled = bytearray(data), list[bytes](), False
    for item in items(data):
        if item.kind == b"Exif":
            hidden[item.kind_at : item.kind_at + 4] = b"skip"
        elif item.kind == b"av01":
            headers += _sequence_headers(item.data)
            check_count(len(headers), "AV1 pictures", MAX_ITEMS)
        is_tiled |= item.kind == b"grid"
    if data[8:12] == b"avis":
        hidden[8:12] = b"avif"
    if not headers:
        raise CorruptImage(DAMAGED, field="image")
    pictures = [_picture(header) for header in headers]
    width, height, _ = max(pictures, key=lambda each: each[0] * each[1])
    planes = sum(each for *_, each in pictures)
    return Container(
        bytes(hidden), (width, height), buffered_bytes=planes * (3 if is_tiled else 2) // 2 + planes // 2, copies=2
    )


def _sequence_headers(data: bytes) -> list[bytes]:
    """Return the beginnings of all sequence headers (5.5.1) in an AV1 picture."""
    at, count, headers = 0, 0, []
    while at < len(data):
        check_count(count := count + 1, "parts of an AV1 picture", MAX_UNITS)
        header, at = data[at], at + 1 + (data[at] >> 2 & 1)
        size = len(data) - at
        if header & 2:
            size, at = _leb128(data, at)
        if header >> 3 & 15 == SEQUENCE_HEADER:
            headers.append(data[at : at + min(size, HEAD_BITS // 8)])
        at += size
    return headers


def _leb128(data: bytes, at: int) -> tuple[int, int]:
    """Return a number of variable length (4.10.5), and the offset after it."""
    value = 0
    for index in range(8):
        byte = data[at + index] if at + index < len(data) else 0
        value |= (byte & 127) << 7 * index
        if byte < 128:
            return value, at + index + 1
    raise CorruptImage(DAMAGED, field="image")


def _picture(header: bytes) -> Picture:
    """Return the largest size that the frames of a sequence may have."""
    bits = _Bits(header)
    profile, is_reduced = bits.take(3), bits.take(2) & 1
    if is_reduced:
        bits.take(5)
    else:
        _skip_operating_points(bits)
    width_bits, height_bits = bits.take(4) + 1, bits.take(4) + 1
    width, height = bits.take(width_bits) + 1, bits.take(height_bits) + 1
    is_loose = width_bits > width.bit_length() or height_bits > height.bit_length()
    if profile not in SAMPLES or (is_loose and not is_reduced):
        raise CorruptImage(DAMAGED, field="image")  # each frame could have a size of its own, of that many bits
    _skip_tools(bits, is_reduced)
    is_deep = bits.take(1)
    if profile == 2 and is_deep:
        bits.take(1)  # 10 or 12 bits
    is_gray = profile != 1 and bits.take(1)
    return width, height, int(width * height * (1 if is_gray else SAMPLES[profile]) * (1 + is_deep))


def _skip_tools(bits: "_Bits", is_reduced: int) -> None:
    """Pass the coding tools, between the size and the color."""
    if not is_reduced and bits.take(1):
        bits.take(7)  # frame numbers
    bits.take(3)
    if not is_reduced:
        bits.take(4)
        has_order = bits.take(1)
        bits.take(2 * has_order)
        if bits.take(1) or bits.take(1):  # screen content: chosen for each frame, or for all
            _ = bits.take(1) or bits.take(1)
        bits.take(3 * has_order)
    bits.take(3)


def _skip_operating_points(bits: "_Bits") -> None:
    has_model = delay_bits = 0
    if bits.take(1):
        bits.take(64)
        if bits.take(1):  # equal intervals: a number of variable length
            bits.take(bits.zeros())
        has_model = bits.take(1)
        if has_model:
            delay_bits = bits.take(5) + 1
            bits.take(42)
    has_delay = bits.take(1)
    for _ in range(bits.take(5) + 1):
        bits.take(12)
        if bits.take(5) > 7:
            bits.take(1)
        if has_model and bits.take(1):
            bits.take(2 * delay_bits + 1)
        if has_delay and bits.take(1):
            bits.take(4)


class _Bits:
    """A cursor over bits, the highest of each byte first; beyond the end they are 0."""

    def __init__(self, data: bytes) -> None:
        self._value, self._left = int.from_bytes(data.ljust(HEAD_BITS // 8, b"\0"), "big"), HEAD_BITS

    def take(self, count: int) -> int:
        """Return the next bits as a number."""
        self._left -= count
        if self._left < 0:
            raise CorruptImage(DAMAGED, field="image")
        return self._value >> self._left & (1 << count) - 1

    def zeros(self) -> int:
        """Count zeros up to the next one, and pass both."""
        count = 0
        while not self.take(1):
            count += 1
        return count
