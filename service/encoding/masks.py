"""The object's matte in a photo, from its transparency, a uniform border or a network; and sums over it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt
from PIL import Image

from service.encoding import compiled

Mask = Literal["alpha", "border", "matting", "none"]
Matte = npt.NDArray[np.uint8]  # (H, W), 0 for background to 255 for the object
MattingFunction = Callable[[Image.Image], Matte]  # takes an RGB image; `service.encoding.matting` implements it

ALPHA_FLOOR: Final = 8  # of 255; fainter pixels are background
MATTING_FLOOR: Final = 128  # of 255; in a matte from a network, pixels above it are object
TRACE: Final = 20  # of 255; that much of a pixel stays where a network removes it, as it may have been the object
MIN_TRANSPARENT: Final = 0.05  # of the pixels; less is rounded corners or stray pixels, and separates nothing
BORDER_TOLERANCE: Final = 12  # of 255, largest channel difference to the border's median
BORDER_SOFTNESS: Final = 16  # of 255, a power of 2; over this the matte rises from 0 to 1
BORDER_SHARE: Final = 0.8  # of the border's pixels must be alike for a uniform border
STRIP: Final = 255  # rows whose pixels a byte can count
EXACT: Final = 64  # squares of bytes whose float32 sum is exact in any order, and a row that vectors add fast


@dataclass(frozen=True)
class Sums:
    """Sums over a matte.

    rows, columns : number of pixels above a floor in each row, (H,), and column, (W,).
    total, squares : sum of the matte's values, and of their squares.
    """

    rows: npt.NDArray[np.int32]
    columns: npt.NDArray[np.int32]
    total: int
    squares: int


def matte_of(image: Image.Image, matting: MattingFunction | None) -> tuple[Mask, Matte | None]:
    """Return the source of the mask, and the matte of an RGB or RGBA image; None if no source applies."""
    if image.mode == "RGBA":
        alpha = np.asarray(image.getchannel("A"))
        if _separates(alpha):
            return "alpha", alpha
        return _matte_within(image, alpha, matting)
    matte = _border_matte(image)
    if matte is not None:
        return "border", matte
    return ("matting", matting(image)) if matting else ("none", None)


def with_trace(matte: Matte, image: Image.Image) -> Matte:
    """Return a matte (H, W) that leaves a trace of what it removes from an RGB or RGBA image."""
    alpha = np.asarray(image.getchannel("A")) if image.mode == "RGBA" else np.uint8(255)
    trace: Matte = np.maximum(matte, np.minimum(alpha, np.uint8(TRACE)))  # what is transparent leaves none
    return trace


def visible(image: Image.Image) -> Matte:
    """Return the matte (H, W) of all pixels of an RGB or RGBA image that are not fully transparent."""
    if image.mode != "RGBA":
        return np.full(image.size[::-1], 255, np.uint8)
    return np.where(np.asarray(image.getchannel("A")) > 0, np.uint8(255), np.uint8(0))


def _separates(alpha: Matte) -> bool:
    """Return whether an alpha (H, W) tells an object from a background, not counting a thin frame."""
    edge, highest = _edge(alpha.shape[:2]), int(alpha.max())
    inner = alpha[edge:-edge, edge:-edge] if min(alpha.shape) > 2 * edge else alpha
    return highest <= ALPHA_FLOOR or bool((2 * inner.astype(int) < highest).mean() >= MIN_TRANSPARENT)


def _matte_within(image: Image.Image, alpha: Matte, matting: MattingFunction | None) -> tuple[Mask, Matte | None]:
    """Return source and matte of an RGBA image as if its few transparent pixels were more of its border."""
    opacity = (alpha / alpha.max() * 255).astype(np.uint8)
    left, top, right, bottom = box = Image.fromarray((opacity >= 128).astype(np.uint8)).getbbox() or (0, 0, *image.size)
    inner, opacity = image.crop(box), opacity[top:bottom, left:right]
    edge = _edge(inner.size)
    ring = _ring(np.asarray(inner)[..., :3], edge)[_ring(opacity, edge) >= 128]
    fill = Image.new("RGB", inner.size, tuple(np.median(ring, axis=0).astype(int).tolist()))
    mask, matte = matte_of(Image.composite(inner.convert("RGB"), fill, Image.fromarray(opacity)), matting)
    if matte is None:
        return mask, None
    whole = np.zeros_like(alpha)
    whole[top:bottom, left:right] = np.minimum(matte, opacity)
    return mask, whole


def _border_matte(image: Image.Image) -> Matte | None:
    """Return the matte of the pixels of an RGB image that differ from a uniform border; None if it is not uniform."""
    pixels = compiled.load()
    picture = compiled.picture_of(image) if pixels else None
    if pixels is None or picture is None:
        return _numpy_border_matte(image)
    matte = np.empty((image.height, image.width), np.uint8)
    edge = _edge(matte.shape)
    is_uniform = pixels.border_matte(picture, edge, BORDER_TOLERANCE, BORDER_SOFTNESS, BORDER_SHARE, matte)
    return matte if is_uniform else None


def _numpy_border_matte(image: Image.Image) -> Matte | None:
    """Compute what `_border_matte` returns, without the compiled functions."""
    shape = image.height, image.width
    farthest = np.zeros(shape, np.uint8)  # largest channel difference to the border's median
    higher, lower = np.empty_like(farthest), np.empty_like(farthest)
    for band in "RGB":  # one plane at a time, for NumPy's vector instructions; Pillow's operations on pixels use none
        plane = np.frombuffer(image.tobytes("raw", band), np.uint8).reshape(shape)
        median = int(np.median(_ring(plane, _edge(shape))))
        # np.maximum is 15 times as slow as np.clip if one side is a single number.
        np.clip(plane, median, 255, out=higher)
        higher -= np.clip(plane, 0, median, out=lower)
        np.maximum(farthest, higher, out=farthest)
    if (_ring(farthest, _edge(shape)) <= BORDER_TOLERANCE).mean() < BORDER_SHARE:
        return None
    return _ramp(farthest)


def _ramp(difference: Matte) -> Matte:
    """Return the matte for differences (H, W), which it overwrites: (difference - tolerance) * 255 / softness."""
    steps = np.clip(difference, BORDER_TOLERANCE, BORDER_TOLERANCE + BORDER_SOFTNESS, out=difference)
    steps -= np.uint8(BORDER_TOLERANCE)
    is_above = steps > 0
    steps *= np.uint8(256 // BORDER_SOFTNESS)  # 256 becomes 0, and 255 below
    steps -= is_above  # rounded down: 255 / softness is just below 256 / softness
    return steps


def _edge(size: tuple[int, ...]) -> int:
    """Return the width of an image's border, pixels."""
    return max(1, min(size) // 64)


def _ring(pixels: npt.NDArray[np.uint8], edge: int) -> npt.NDArray[np.uint8]:
    """Return the pixels within `edge` of a side, corners twice: (H, W, ...) -> (n, ...)."""
    sides = (pixels[:edge], pixels[-edge:], pixels[:, :edge], pixels[:, -edge:])
    return np.concatenate([side.reshape(-1, *pixels.shape[2:]) for side in sides])


def sums_of(matte: Matte, floor: int) -> Sums:
    """Sum a matte (H, W), and count its pixels above a floor."""
    pixels = compiled.load()
    if pixels is None:
        return _numpy_sums_of(matte, floor)
    rows, columns = np.empty(matte.shape[0], np.int32), np.empty(matte.shape[1], np.int32)
    total, squares = pixels.summary(matte, floor, rows, columns)
    return Sums(rows, columns, total, squares)


def _numpy_sums_of(matte: Matte, floor: int) -> Sums:
    """Compute what `sums_of` returns, without the compiled functions."""
    solid = (matte > floor).view(np.uint8)
    rows = np.bitwise_count(np.packbits(solid, axis=1)).sum(axis=1, dtype=np.int32)
    strips = [solid[top : top + STRIP].sum(axis=0, dtype=np.uint8) for top in range(0, len(solid), STRIP)]
    values = matte[_extent(matte.max(axis=1)), _extent(matte.max(axis=0))].ravel().astype(np.float32)
    whole = len(values) // EXACT * EXACT
    parts = values[:whole].reshape(-1, EXACT), values[None, whole:]
    total = sum(float(part.sum(axis=1).sum(dtype=np.float64)) for part in parts)
    squares = sum(float(np.vecdot(part, part).sum(dtype=np.float64)) for part in parts)
    return Sums(rows, np.sum(strips, axis=0, dtype=np.int32), int(total), int(squares))


def _extent(values: Matte) -> slice:
    """Return the range from the first to the last value (n,) above 0; an empty one if there is none."""
    places = np.flatnonzero(values)
    return slice(places[0], places[-1] + 1) if len(places) else slice(0)
