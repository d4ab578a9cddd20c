"""Photos that tests draw, and files around them that Pillow does not write."""

import io
import struct
import zlib

from PIL import Image, ImageDraw


def image_file(image: Image.Image, kind: str = "PNG", **options: object) -> bytes:
    """Return the image as a file's bytes."""
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def disc(color: str = "red", size: tuple[int, int] = (120, 90), at: tuple[int, int] = (40, 30)) -> Image.Image:
    """Draw a disc of 41 pixels on white, the corner of its box at `at`."""
    image = Image.new("RGB", size, "white")
    ImageDraw.Draw(image).ellipse((*at, at[0] + 40, at[1] + 40), fill=color)
    return image


def png_chunk(kind: bytes, data: bytes) -> bytes:
    """Return a chunk of a PNG, with its checksum."""
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png_file(width: int, height: int, depth: int, color_type: int, rows: bytes, *extra: bytes) -> bytes:
    """Return a PNG from its raw rows, with chunks before them, for the modes that Pillow does not write."""
    header = struct.pack(">IIBBBBB", width, height, depth, color_type, 0, 0, 0)
    chunks = [png_chunk(b"IHDR", header), *extra, png_chunk(b"IDAT", zlib.compress(rows)), png_chunk(b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def with_metadata(file: bytes, name: bytes, data: bytes) -> bytes:
    """Return a PNG, JPEG or WebP with one more chunk or segment, near its beginning.

    Parameters
    ----------
    name : the chunk's four letters; for a JPEG the byte of the marker, followed by what the segment begins with.
    """
    if file.startswith(b"\x89PNG"):
        return file[:33] + png_chunk(name, data) + file[33:]  # after IHDR
    if file.startswith(b"\xff\xd8"):
        content = name[1:] + data
        return file[:2] + b"\xff" + name[:1] + struct.pack(">H", len(content) + 2) + content + file[2:]
    flags = {b"EXIF": 0x08, b"XMP ": 0x04, b"ICCP": 0x20}
    chunks = file[12:] + name + struct.pack("<I", len(data)) + data + bytes(len(data) % 2)
    if not chunks.startswith(b"VP8X"):
        with Image.open(io.BytesIO(file)) as image:
            width, height = image.size
        sides = struct.pack("<I", width - 1)[:3] + struct.pack("<I", height - 1)[:3]
        chunks = b"VP8X" + struct.pack("<II", 10, 0) + sides + chunks
    flagged = chunks[:8] + bytes([chunks[8] | flags[name]]) + chunks[9:]
    return b"RIFF" + struct.pack("<I", len(flagged) + 4) + b"WEBP" + flagged


def many_scans(count: int, side: int = 512) -> bytes:
    """Return a progressive JPEG of (side, side) pixels whose last scan comes `count` times more."""
    data = image_file(disc("blue", (side, side), (80, 80)), "JPEG", progressive=True)
    start = data.rindex(b"\xff\xda")
    return data[:-2] + data[start:-2] * count + b"\xff\xd9"
