"""Photos for load: no two have the same bytes, so each is encoded, and all cost the same to decode."""

import io
import itertools
from collections.abc import Iterator
from functools import cache
from typing import Final

import numpy as np
from PIL import Image, ImageDraw, ImageFilter

SIDE: Final = 512
KINDS: Final = 24


def photos(seed: int = 0) -> Iterator[bytes]:
    """Yield JPEGs without end, 512 x 512: textured shapes on white, each with a comment of its own.

    All pictures are drawn before the first one is returned.
    """
    kinds = _kinds()
    return (_with_comment(kinds[number % KINDS], f"{seed}-{number}".encode()) for number in itertools.count())


@cache
def _kinds() -> list[bytes]:
    return [_photo(seed) for seed in range(KINDS)]


def _with_comment(jpeg: bytes, comment: bytes) -> bytes:
    """Insert a comment segment after the first marker: the same picture in other bytes."""
    return jpeg[:2] + b"\xff\xfe" + (len(comment) + 2).to_bytes(2, "big") + comment + jpeg[2:]


def _photo(seed: int) -> bytes:
    dice = np.random.default_rng(seed)
    grain = dice.integers(0, 255, (SIDE, SIDE, 3), np.uint8)
    texture = Image.fromarray(grain).filter(ImageFilter.GaussianBlur(3))
    mask = Image.new("L", (SIDE, SIDE))
    left, top, right, bottom = (int(edge) for edge in dice.integers((40, 40, 300, 300), (200, 200, 470, 470)))
    ImageDraw.Draw(mask).ellipse((left, top, right, bottom), fill=255)
    buffer = io.BytesIO()
    Image.composite(texture, Image.new("RGB", (SIDE, SIDE), "white"), mask).save(buffer, "JPEG", quality=90)
    return buffer.getvalue()
