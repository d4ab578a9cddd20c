"""The container of binary glTF (GLB): a file header, a chunk of JSON, and a chunk of numbers."""

import struct
from typing import Final

OVERHEAD: Final = 12 + 8 + 8  # bytes of the headers: of the file and of both chunks


def glb_head(text: bytes, data_bytes: int) -> bytes:
    """Return a file up to its numbers, of which `data_bytes` follow, a multiple of 4."""
    text = text.ljust(-len(text) % 4 + len(text))  # chunks end at multiples of 4 bytes
    return b"".join(
        [
            struct.pack("<4sII", b"glTF", 2, OVERHEAD + len(text) + data_bytes),
            struct.pack("<I4s", len(text), b"JSON"),
            text,
            struct.pack("<I4s", data_bytes, b"BIN\0"),
        ]
    )
