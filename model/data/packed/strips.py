"""Views of a shape side by side in one WebP image. Imports no torch, so that worker processes start quickly."""

import io
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

Bytes = npt.NDArray[np.uint8]

MAX_STRIP: Final = 16_383  # pixels, WebP's limit of a side
STRIPS: Final = 16  # decoded by a worker at a time


def encode_strip(views: Bytes, quality: int | None) -> bytes:
    """Encode views (v, s, s, 4) RGBA side by side as WebP; a `quality` of None is lossless.

    Raises
    ------
    ValueError : the views are too many for one WebP image.
    """
    count, side = views.shape[:2]
    if count * side > MAX_STRIP:
        raise ValueError(f"{count} views of {side} pixels are wider than WebP's {MAX_STRIP}: pack fewer views")
    strip = Image.fromarray(np.concatenate(list(views), axis=1))
    target = io.BytesIO()
    strip.save(target, "WEBP", lossless=quality is None, quality=75 if quality is None else quality, method=4)
    return target.getvalue()


def decode_strip(strip: bytes, side: int) -> Bytes:
    """Decode what `encode_strip` made into views (v, side, side, 4), resized where they were stored at another size."""
    with Image.open(io.BytesIO(strip)) as image:
        views = np.asarray(image.convert("RGBA"))
    stored = views.shape[0]
    views = views.reshape(stored, -1, stored, 4).swapaxes(0, 1)  # (v, stored, stored, 4)
    if stored == side:
        return np.ascontiguousarray(views)
    resized = [Image.fromarray(view).resize((side, side), Image.Resampling.HAMMING) for view in views]
    return np.stack([np.asarray(each) for each in resized])


def decode(strips: Sequence[bytes], side: int, workers: int) -> Bytes:
    """Decode strips into views (views, side, side, 4), in `workers` processes; 1 decodes in this one."""
    parts = [strips[start : start + STRIPS] for start in range(0, len(strips), STRIPS)]
    if workers <= 1 or len(parts) == 1:
        return np.concatenate([_decode_part(part, side) for part in parts])
    with ProcessPoolExecutor(min(workers, len(parts)), mp_context=get_context("spawn")) as pool:
        return np.concatenate(list(pool.map(_decode_part, parts, [side] * len(parts))))


def _decode_part(strips: Sequence[bytes], side: int) -> Bytes:
    return np.concatenate([decode_strip(strip, side) for strip in strips])
