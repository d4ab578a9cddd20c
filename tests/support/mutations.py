"""Damaged images without end, each with a number: small files of every sort, mutated one to three times.

Bits flip, runs of bytes are overwritten or lost, files break off; chunks and segments are repeated, swapped or left
out, their lengths lie, and two files are joined. Half of the PNGs get true checksums again, or none would be decoded.
"""

import io
import random
import struct
import zlib
from collections.abc import Callable, Iterator
from functools import cache
from itertools import pairwise
from typing import Final

import numpy as np
from PIL import Image, ImageDraw

WIDTH, HEIGHT = 61, 43  # odd: the last bits of a row and of a block are not used
PNG: Final = b"\x89PNG\r\n\x1a\n"
ADAM7: Final = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))
ODD: Final = (0, 1, 2, 3, 0x7F, 0xFF, 0x7FFF, 0xFFFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)  # lengths that lie

Mutation = Callable[[random.Random, bytes], bytes]


def mutant(number: int) -> bytes:
    """Return the damaged image with a number."""
    return mutated(random.Random(number))


def mutated(dice: random.Random) -> bytes:
    """Return a damaged image, drawn by dice."""
    data = dice.choice(seeds())
    for _ in range(dice.randint(1, 3)):
        data = dice.choice(MUTATIONS)(dice, data)
    return _with_checksums(data) if dice.random() < 0.5 else data


@cache
def seeds() -> tuple[bytes, ...]:
    """Return sound files of every sort that the service reads, some hundred bytes each."""
    image = Image.new("RGB", (WIDTH, HEIGHT), "white")
    ImageDraw.Draw(image).ellipse((10, 5, 45, 35), fill="navy", outline="red")
    clear = image.convert("RGBA")
    clear.putalpha(image.convert("L").point(lambda level: 255 - level))
    palette, other = image.quantize(16), image.transpose(Image.Transpose.ROTATE_180)
    gray16 = Image.fromarray((np.asarray(image.convert("L"), np.uint16) * 257).astype(np.uint16))
    turned = Image.Exif()
    turned[0x0112] = 6
    png = [
        _file(image, "PNG"),
        _file(clear, "PNG", dpi=(72, 72)),
        _file(palette, "PNG", transparency=0),
        _file(image.convert("1"), "PNG"),
        _file(image.convert("LA"), "PNG"),
        _file(gray16, "PNG"),
        _file(image, "PNG", exif=turned),
        _file(image, "PNG", save_all=True, append_images=[other]),
        _interlaced(image),
    ]
    jpeg = [
        _file(image, "JPEG"),
        _file(image, "JPEG", progressive=True, quality=60),
        _file(image.convert("CMYK"), "JPEG"),
        _file(image.convert("L"), "JPEG", restart_marker_blocks=2),
        _file(image, "JPEG", exif=turned, comment="a comment", subsampling=0),
    ]
    webp = [
        _file(image, "WEBP"),
        _file(image, "WEBP", lossless=True),
        _file(clear, "WEBP"),
        _file(clear, "WEBP", exif=turned),
        _file(image, "WEBP", save_all=True, append_images=[other]),
    ]
    return (*png, *jpeg, *webp)


def _file(image: Image.Image, kind: str, **options: object) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def _interlaced(image: Image.Image) -> bytes:
    """Return a PNG in Adam7's seven passes, which Pillow reads but does not write."""
    pixels = np.asarray(image)
    passes = (pixels[y::down, x::right] for x, y, right, down in ADAM7)
    rows = b"".join(b"\0" + row.tobytes() for part in passes for row in part)
    header = struct.pack(">IIBBBBB", *image.size, 8, 2, 0, 0, 1)
    return PNG + _chunk(b"IHDR", header) + _chunk(b"IDAT", zlib.compress(rows)) + _chunk(b"IEND", b"")


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _starts(data: bytes) -> list[int]:
    """Return the offsets of a file's chunks or segments, as far as they are in order, and the end of the last one."""
    if data.startswith(b"\xff\xd8"):
        return [
            0,
            *(at for at in range(2, len(data) - 1) if data[at] == 0xFF and data[at + 1] not in (0, 0xFF)),
            len(data),
        ]
    is_png = data.startswith(PNG)
    at = 8 if is_png else 12
    starts = [0]
    while at + 8 <= len(data):
        starts.append(at)
        (size,) = struct.unpack_from(">I" if is_png else "<I", data, at if is_png else at + 4)
        at += size + 12 if is_png else size + size % 2 + 8
    return [*starts, len(data)]


def _chunks(data: bytes) -> Iterator[bytes]:
    return (data[begin:end] for begin, end in pairwise(_starts(data)))


def _with_checksums(data: bytes) -> bytes:
    """Correct the checksums of a PNG's chunks; return other files unchanged."""
    if not data.startswith(PNG):
        return data
    first, *chunks = _chunks(data)
    return first + b"".join(each[:-4] + struct.pack(">I", zlib.crc32(each[4:-4])) for each in chunks)


def _flip(dice: random.Random, data: bytes) -> bytes:
    changed = bytearray(data)
    for _ in range(dice.choice((1, 1, 2, 8, 64))):
        changed[dice.randrange(len(changed))] ^= 1 << dice.randrange(8)
    return bytes(changed)


def _overwrite(dice: random.Random, data: bytes) -> bytes:
    begin, size = dice.randrange(len(data)), dice.choice((1, 2, 4, 16, 256))
    run = dice.choice((b"\0", b"\xff", dice.randbytes(1))) * size if dice.random() < 0.5 else dice.randbytes(size)
    return data[:begin] + run + data[begin + size :]


def _remove(dice: random.Random, data: bytes) -> bytes:
    begin = dice.randrange(len(data))
    return (data[:begin] + data[begin + dice.choice((1, 2, 4, 64)) :]) or data


def _truncate(dice: random.Random, data: bytes) -> bytes:
    return data[: dice.randrange(1, len(data) + 1)]


def _shuffle(dice: random.Random, data: bytes) -> bytes:
    """Repeat, swap or leave out chunks; the signature stays."""
    first, *chunks = _chunks(data)
    if chunks:
        one, other = dice.randrange(len(chunks)), dice.randrange(len(chunks))
        match dice.randrange(3):
            case 0:
                chunks[one:one] = [chunks[other]] * dice.choice((1, 2, 50))
            case 1:
                chunks[one], chunks[other] = chunks[other], chunks[one]
            case _:
                del chunks[one]
    return first + b"".join(chunks)


def _lie(dice: random.Random, data: bytes) -> bytes:
    """Overwrite a chunk's length, or one of its first fields such as the image's sides, with an odd number."""
    at = dice.choice(_starts(data)) + dice.choice((0, 2, 4, 8, 12, 16))
    size, order = dice.choice((2, 4)), dice.choice((">", "<"))
    number = struct.pack(f"{order}Q", dice.choice(ODD))
    return data[:at] + (number[-size:] if order == ">" else number[:size]) + data[at + size :]


def _splice(dice: random.Random, data: bytes) -> bytes:
    """Join the beginning of this file and the end of another, at chunks or anywhere."""
    other = dice.choice(seeds())
    if dice.random() < 0.5:
        return data[: dice.choice(_starts(data)[1:])] + other[dice.choice(_starts(other)) :]
    return data[: dice.randrange(1, len(data) + 1)] + other[dice.randrange(len(other)) :]


MUTATIONS: Final[tuple[Mutation, ...]] = (_flip, _overwrite, _remove, _truncate, _shuffle, _lie, _splice)
