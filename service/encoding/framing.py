"""Bytes of a photo -> the encoder's input, framed exactly as in training.

decode (limits, EXIF, every color mode) -> mask (alpha, else a uniform border, else matting if a model is loaded)
-> square crop around the object -> resize -> composite over white -> (1, 3, size, size) float32 in [0, 1].

A mask from a network can be wrong. So the square then shows less beyond the photo, a trace of what the mask removes
stays, and if the object is large, the encoder also looks at the whole photo: it loses less to wrong masks (RESULTS.md,
photographs). Thumbnails show no trace.
"""

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal, NamedTuple

import numpy as np
import numpy.typing as npt
from PIL import Image

from service.encoding import compiled
from service.encoding.decode import DEFAULT_MAX_PIXELS, check_stop, decode_with_size
from service.encoding.masks import (
    ALPHA_FLOOR,
    MATTING_FLOOR,
    Mask,
    Matte,
    MattingFunction,
    Sums,
    matte_of,
    sums_of,
    visible,
    with_trace,
)
from service.encoding.pixels import THUMBNAIL_SIDE, WORK_SIDE, over_white, reduction, thumbnail_file
from service.errors import InvalidParameter, NoObjectFound

Background = Literal["auto", "keep", "remove"]
Box = tuple[int, int, int, int]

MIN_CONFIDENCE: Final = 0.7  # of a matte from a network; in 40 renders over photographs, wrong mattes had 0.42 to 0.61
MOST_MOVED: Final = 0.06  # of the square's side; further from the middle, encoders make more errors
LARGE: Final = (0.6, 0.7)  # of the photo's longer side: where whole photos begin to count, and where they do in full
MIN_FOREGROUND: Final = 5e-4  # of the image's pixels
NO_MASK: Final = (
    "the background cannot be removed: the image has neither transparency nor a uniform border, and the service runs "
    "without matting (HOF_MATTING_MODEL=none)"
)


@dataclass(frozen=True)
class Framing:
    """Input that an encoder expects.

    size : side of the square image, pixels.
    foreground_ratio : share of that side that the object's longer side takes.
    """

    size: int = 64
    foreground_ratio: float = 0.85

    def with_ratio(self, foreground_ratio: float | None) -> "Framing":
        """Return the same with another share for the object; None keeps the share."""
        return self if foreground_ratio is None else replace(self, foreground_ratio=foreground_ratio)


class Crop(NamedTuple):
    """A square of a photo, around the object.

    rgba : (size, size) image; its alpha is the object's mask.
    mask : source of the mask.
    box : left, top, right, bottom of the object, pixels of the photo.
    confidence : mean of the matte, weighted by itself: 1 if every pixel is either object or background, less
        for each pixel in between. None without a mask.
    thumbnail : the same square at THUMBNAIL_SIDE, if asked for.
    whole : (size, size) image of the whole photo, if the mask is of a network and the object large.
    """

    rgba: Image.Image
    mask: Mask
    box: Box
    confidence: float | None
    thumbnail: Image.Image | None = None
    whole: Image.Image | None = None


@dataclass(frozen=True)
class Framed:
    """An encoder's input and its origin in the photo.

    tensor : (1, 3, size, size) float32 in [0, 1], RGB, the object over white.
    mask : source of the mask.
    box : left, top, right, bottom of the object, pixels of the upright image.
    confidence : confidence of the mask, as in `Crop`.
    width, height : size of the upright image, pixels.
    thumbnail : a small picture of the object, a file; None unless asked for.
    whole : the whole photo as a second input, like `tensor`, if the mask is of a network and the object large.
    """

    tensor: npt.NDArray[np.float32]
    mask: Mask
    box: Box
    confidence: float | None
    width: int
    height: int
    thumbnail: bytes | None = None
    whole: npt.NDArray[np.float32] | None = None

    @property
    def looks(self) -> npt.NDArray[np.float32]:
        """The encoder's inputs, (1, 3, size, size) or (2, 3, size, size)."""
        return self.tensor if self.whole is None else np.concatenate([self.tensor, self.whole])

    @property
    def weights(self) -> list[float]:
        """Weight of each look, 0 to 1."""
        return [1.0] if self.whole is None else [1.0, _weight_of_whole(self.box, (self.width, self.height))]


def frame(
    image: Image.Image,
    framing: Framing,
    background: Background = "auto",
    matting: MattingFunction | None = None,
    *,
    thumbnail: bool = False,
) -> Crop:
    """Crop a square around the object and resize it, with a thumbnail of it if asked for.

    Raises
    ------
    NoObjectFound : the mask is empty, or the matting model is not confident enough.
    InvalidParameter : `background="remove"`, but there is no mask.
    """
    sizes = (framing.size, THUMBNAIL_SIDE) if thumbnail else (framing.size,)
    factor = reduction(image.size)
    work = image.reduce(factor) if factor > 1 else image
    mask, matte = ("none", None) if background == "keep" else matte_of(work, matting)
    if matte is None:
        if background == "remove":
            raise InvalidParameter(NO_MASK, field="background")
        rgba, *thumbnails = _whole(work, sizes)
        return Crop(rgba, mask, (0, 0, *image.size), None, *thumbnails)
    matte = np.ascontiguousarray(matte)
    sums = sums_of(matte, MATTING_FLOOR if mask == "matting" else ALPHA_FLOOR)
    box = _foreground_box(sums)
    confidence = sums.squares / sums.total / 255
    if mask == "matting" and confidence < MIN_CONFIDENCE:
        raise NoObjectFound("no object found in the image: nothing in it stands out clearly enough", field="image")
    square, opacity, whole = _square(box, framing.foreground_ratio), matte, None
    if mask == "matting":
        square, opacity = _within(square, work.size), with_trace(matte, work)
        whole = _whole(work, sizes[:1], visible(work))[0] if _weight_of_whole(box, work.size) > 0 else None
    (rgba,) = _squares(work, opacity, square, sizes[:1])
    small = _squares(work, matte, square, sizes[1:])[0] if thumbnail else None
    width, height = image.size
    left, top, right, bottom = (factor * edge for edge in box)
    box = (left, top, min(right, width), min(bottom, height))
    return Crop(rgba, mask, box, confidence, small, whole)


def preprocess(
    data: bytes,
    framing: Framing,
    background: Background = "auto",
    max_pixels: int = DEFAULT_MAX_PIXELS,
    matting: MattingFunction | None = None,
    stop: threading.Event | None = None,
    *,
    thumbnail: bool = False,
) -> Framed:
    """Turn the bytes of a photo into the encoder's input, with a thumbnail if asked for.

    Raises as `decode` and `frame` do, and concurrent.futures.CancelledError if `stop` is set meanwhile.
    """
    image, (width, height) = decode_with_size(data, max_pixels, stop)
    check_stop(stop)
    crop = frame(image, framing, background, matting, thumbnail=thumbnail)
    x, y = width / image.width, height / image.height  # above 1 for a JPEG decoded at reduced size
    left, top, right, bottom = crop.box
    box = (round(left * x), round(top * y), round(right * x), round(bottom * y))
    small = thumbnail_file(crop.thumbnail) if crop.thumbnail else None
    whole = over_white(crop.whole) if crop.whole else None
    return Framed(over_white(crop.rgba), crop.mask, box, crop.confidence, width, height, small, whole)


def _foreground_box(sums: Sums) -> Box:
    """Return the bounding box of the pixels above the floor, without specks. Raises NoObjectFound."""
    if sums.rows.sum() / (len(sums.rows) * len(sums.columns)) < MIN_FOREGROUND:
        raise NoObjectFound("no object found in the image: nothing stands out from its background", field="image")
    (top, bottom), (left, right) = _span(sums.rows), _span(sums.columns)
    return left, top, right, bottom


def _span(counts: npt.NDArray[np.int32]) -> tuple[int, int]:
    """Return the first index and one past the last, after 0.02% of the foreground are cut from each end."""
    total = np.cumsum(counts)
    slack = int(total[-1] * 2e-4)
    return int(np.searchsorted(total, slack, side="right")), int(np.searchsorted(total, total[-1] - slack)) + 1


def _squares(image: Image.Image, matte: Matte | None, square: Box, sizes: Sequence[int]) -> list[Image.Image]:
    """Cut out a square, RGBA, and resize it to (size, size) for each size.

    Parameters
    ----------
    matte : of the image; None to keep its transparency.
    """
    pixels, (left, top, right, _) = compiled.load(), square
    side = right - left
    is_alike = side // (2 * WORK_SIDE) <= 1 and all(size < side <= compiled.MOST_SUMMED * size for size in sizes)
    picture = compiled.picture_of(image) if pixels and matte is not None and is_alike else None
    if pixels is None or matte is None or picture is None:
        part = _cut_out(image, None if matte is None else Image.fromarray(matte), square)
        return [_fit(part, size) for size in sizes]
    results = {size: np.empty((size, size, 4), np.uint8) for size in sizes}
    for rgba in results.values():
        pixels.square(picture, matte, left, top, side, rgba)
    return [Image.fromarray(results[size]) for size in sizes]


def _whole(image: Image.Image, sizes: Sequence[int], matte: Matte | None = None) -> list[Image.Image]:
    """Resize an image, RGBA, to (size, size) for each size, with a margin along its longer sides.

    Parameters
    ----------
    matte : of the image; None to keep its transparency.
    """
    return _squares(image, matte, _square((0, 0, *image.size), 1.0), sizes)


def _weight_of_whole(box: Box, size: tuple[int, int]) -> float:
    """Return how much a whole picture counts, 0 to 1. It changes steadily with the share that the box takes."""
    (left, top, right, bottom), (least, full) = box, LARGE
    share = max(right - left, bottom - top) / max(size)
    return min(1.0, max(0.0, (share - least) / (full - least)))


def _cut_out(image: Image.Image, alpha: Image.Image | None, square: Box) -> Image.Image:
    """Cut out a square, RGBA, in full size or somewhat reduced.

    Parameters
    ----------
    alpha : matte of the image; None to keep its transparency.
    """
    if alpha is None:
        image = image.convert("RGBA")
    left, top, right, _ = square
    shrink = (right - left) // (2 * WORK_SIDE)
    if shrink > 1:  # a small ratio makes a square far larger than the image
        if alpha is not None:  # reduced together: transparent pixels do not count
            image = image.copy()
            image.putalpha(alpha)
            alpha = None
        image = image.reduce(shrink)
        x, y, side = left // shrink, top // shrink, (right - left) // shrink
        square = x, y, x + side, y + side
    part = image.crop(square)
    if alpha is not None:
        part.putalpha(alpha.crop(square))
    return part


def _fit(square: Image.Image, size: int) -> Image.Image:
    """Resize a square to (size, size)."""
    resampling = Image.Resampling.BOX if square.width >= size else Image.Resampling.BILINEAR
    return square.resize((size, size), resampling)


def _square(box: Box, foreground_ratio: float) -> Box:
    """Return the square around the box's center whose side, times `foreground_ratio`, is the box's longer side."""
    left, top, right, bottom = box
    side = max(1, round(max(right - left, bottom - top) / foreground_ratio))
    x, y = (left + right - side) // 2, (top + bottom - side) // 2  # rounds in the same way at every position
    return x, y, x + side, y + side


def _within(square: Box, size: tuple[int, int]) -> Box:
    """Return a square no larger than a picture's longer side, moved toward the picture by MOST_MOVED at most.

    So it shows less beyond the picture, and the object stays near the middle.
    """
    left, top, right, _ = square
    side = min(right - left, max(size))
    most, middle = round(MOST_MOVED * side), (right - left - side) // 2
    x, y = (
        low + middle + max(-most, min(most, _way_into(low + middle, side, length)))
        for low, length in zip((left, top), size, strict=True)
    )
    return x, y, x + side, y + side


def _way_into(low: int, side: int, length: int) -> int:
    """Return how far a range of `side` from `low` on has to move to lie within 0 to `length`; 0 if it is longer."""
    return min(max(0, low), length - side) - low if side <= length else 0
