"""Bytes of a photo -> the encoder's input, framed exactly as in training.

decode (limits, EXIF, every colour mode) -> mask (alpha, else a uniform border) -> square crop around
the object -> resize -> composite over white -> (1, 3, size, size) float32 in [0, 1].
"""

import io
import struct
import zlib
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageFile, ImageOps
from PIL.JpegImagePlugin import JpegImageFile
from PIL.PngImagePlugin import PngImageFile
from PIL.WebPImagePlugin import WebPImageFile

from service.errors import CorruptImage, NoObjectFound, TooLarge, UnsupportedMedia

Background = Literal["auto", "keep", "remove"]
Mask = Literal["alpha", "border", "none"]
Box = tuple[int, int, int, int]

DEFAULT_MAX_PIXELS: Final = 32_000_000
MAX_SIDE: Final = 65_535
WORK_SIDE: Final = 1024  # longest side on which masks are found and crops are taken
ALPHA_FLOOR: Final = 8  # of 255; fainter pixels are background
BORDER_TOLERANCE: Final = 12  # of 255, largest channel difference to the border's median
BORDER_SOFTNESS: Final = 16  # of 255; over this the matte rises from 0 to 1
BORDER_SHARE: Final = 0.8  # of the border's pixels must look alike for a uniform border
MIN_FOREGROUND: Final = 5e-4  # of the image's pixels

_DECODE_ERRORS = (
    OSError,
    SyntaxError,
    ValueError,
    IndexError,
    KeyError,
    EOFError,
    OverflowError,
    struct.error,
    zlib.error,
)


@dataclass(frozen=True)
class Framing:
    """How an encoder wants its input: a square of `size` pixels, whose longest object side takes
    `foreground_ratio` of it."""

    size: int = 64
    foreground_ratio: float = 0.85


@dataclass(frozen=True)
class Framed:
    """An encoder's input and how it came about.

    tensor : (1, 3, size, size) float32 in [0, 1], RGB, the object over white.
    mask : which mask was taken.
    box : left, top, right, bottom of what was taken, pixels of the upright image.
    width, height : of the upright image, pixels.
    """

    tensor: npt.NDArray[np.float32]
    mask: Mask
    box: Box
    width: int
    height: int


def decode(data: bytes, max_pixels: int = DEFAULT_MAX_PIXELS) -> Image.Image:
    """Decode a PNG, JPEG or WebP, told by its content, to an upright RGB or RGBA image.

    Sixteen-bit samples are reduced to eight; palettes, grey and CMYK become RGB; of an animation the
    first frame counts.

    Raises
    ------
    UnsupportedMedia : the bytes are none of the three types.
    TooLarge : the header announces more than `max_pixels`; nothing is decoded then.
    CorruptImage : the bytes break off or make no sense.
    """
    return _decode(data, max_pixels)[0]


def frame(image: Image.Image, framing: Framing, background: Background = "auto") -> tuple[Image.Image, Mask, Box]:
    """Crop a square around the object and resize it: RGBA of (size, size), which mask, its box.

    Raises
    ------
    NoObjectFound : the mask is empty, or `background="remove"` found no mask.
    """
    factor = max(1, -(-max(image.size) // WORK_SIDE))
    work = image.reduce(factor) if factor > 1 else image
    rgba, mask = _matte(work, background)
    box = (0, 0, *work.size) if mask == "none" else _foreground_box(np.asarray(rgba)[..., 3])
    crop = _crop(rgba, box, 1.0 if mask == "none" else framing.foreground_ratio, framing.size)
    width, height = image.size
    left, top, right, bottom = (factor * edge for edge in box)
    return crop, mask, (left, top, min(right, width), min(bottom, height))


def preprocess(
    data: bytes,
    framing: Framing,
    background: Background = "auto",
    max_pixels: int = DEFAULT_MAX_PIXELS,
) -> Framed:
    """A photo's bytes -> the encoder's input. Raises as `decode` and `frame` do."""
    image, (width, height) = _decode(data, max_pixels)
    crop, mask, (left, top, right, bottom) = frame(image, framing, background)
    x, y = width / image.width, height / image.height  # above 1 where a JPEG was decoded at a part of its size
    box = (round(left * x), round(top * y), round(right * x), round(bottom * y))
    return Framed(over_white(crop), mask, box, width, height)


def over_white(rgba: Image.Image) -> npt.NDArray[np.float32]:
    """Composite an RGBA image of (size, size) over white: (1, 3, size, size) float32 in [0, 1]."""
    pixels = np.asarray(rgba, dtype=np.float32) / 255  # (size, size, 4)
    alpha = pixels[..., 3:]
    rgb = pixels[..., :3] * alpha + (1 - alpha)
    return np.ascontiguousarray(rgb.transpose(2, 0, 1)[None])  # (1, 3, size, size)


def _opener(data: bytes) -> type[ImageFile.ImageFile]:
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return PngImageFile
    if data.startswith(b"\xff\xd8\xff"):
        return JpegImageFile
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return WebPImageFile
    raise UnsupportedMedia("the body is no PNG, JPEG or WebP image", field="image")


def _decode(data: bytes, max_pixels: int) -> tuple[Image.Image, tuple[int, int]]:
    """As `decode`, and the width and height that the upright image has in full size."""
    opener = _opener(data)
    try:
        image = opener(io.BytesIO(data))
        width, height = image.size
        if width * height > max_pixels or max(width, height) > MAX_SIDE:
            raise TooLarge(f"the image has {width} x {height} pixels, the limit is {max_pixels} in all", field="image")
        if isinstance(image, JpegImageFile):
            image.draft("RGB", (WORK_SIDE, WORK_SIDE))  # decodes at 1/2, 1/4 or 1/8 where that is enough
        image.load()
        upright = ImageOps.exif_transpose(image)
        return _to_rgb(upright), (width, height) if upright.size == image.size else (height, width)
    except Image.DecompressionBombError as error:  # Pillow's own limit, before it makes a WebP decoder
        raise TooLarge(f"the image has more than {max_pixels} pixels, the limit", field="image") from error
    except _DECODE_ERRORS as error:
        raise CorruptImage("the image is truncated or corrupt", field="image") from error


def _to_rgb(image: Image.Image) -> Image.Image:
    """Any mode -> RGBA where some pixel is transparent, else RGB."""
    if image.mode.startswith("I"):  # 16-bit grey: convert() would clip, not scale
        return _from_grey16(np.asarray(image).astype(np.int64), image.info.get("transparency"))
    if image.has_transparency_data:
        rgba = image.convert("RGBA")
        low, _ = rgba.getchannel("A").getextrema()
        return rgba if low != 255 else rgba.convert("RGB")
    return image.convert("RGB")


def _from_grey16(values: npt.NDArray[np.int64], transparent: int | None) -> Image.Image:
    """Grey of 16 bits -> RGB, or RGBA where one value stands for transparent (PNG's tRNS)."""
    grey = Image.fromarray((values >> 8).clip(0, 255).astype(np.uint8))
    if transparent is None or not (values == transparent).any():
        return grey.convert("RGB")
    rgba = grey.convert("RGBA")
    rgba.putalpha(Image.fromarray(np.where(values == transparent, 0, 255).astype(np.uint8)))
    return rgba


def _matte(image: Image.Image, background: Background) -> tuple[Image.Image, Mask]:
    """The image as RGBA, its alpha saying what is object, and where that alpha comes from."""
    if image.mode == "RGBA" and background != "keep":
        return image, "alpha"
    if background != "keep":
        alpha = _border_matte(np.asarray(image))
        if alpha is not None:
            rgba = image.convert("RGBA")
            rgba.putalpha(Image.fromarray(alpha))
            return rgba, "border"
    if background == "remove":
        raise NoObjectFound(
            "the background cannot be removed: the image has neither transparency nor a uniform border", field="image"
        )
    return image.convert("RGBA"), "none"


def _border_matte(rgb: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8] | None:
    """Alpha (H, W) of what differs from a uniform border; None where the border is not uniform."""
    edge = max(1, min(rgb.shape[:2]) // 64)
    border = np.concatenate([part.reshape(-1, 3) for part in (rgb[:edge], rgb[-edge:], rgb[:, :edge], rgb[:, -edge:])])
    colour = np.median(border, axis=0).astype(np.int16)
    alike = np.abs(border.astype(np.int16) - colour).max(axis=1) <= BORDER_TOLERANCE
    if alike.mean() < BORDER_SHARE:
        return None
    distance = np.abs(rgb.astype(np.int16) - colour).max(axis=2)
    ramp: npt.NDArray[np.float64] = (distance - BORDER_TOLERANCE) * (255 / BORDER_SOFTNESS)
    return ramp.clip(0, 255).astype(np.uint8)


def _foreground_box(alpha: npt.NDArray[np.uint8]) -> Box:
    """Bounding box of the opaque pixels, specks left out."""
    solid = alpha > ALPHA_FLOOR
    if solid.mean() < MIN_FOREGROUND:
        raise NoObjectFound("no object found in the image: nothing stands out from its background", field="image")
    rows, columns = _span(solid.sum(axis=1)), _span(solid.sum(axis=0))
    return columns[0], rows[0], columns[1], rows[1]


def _span(counts: npt.NDArray[np.int_]) -> tuple[int, int]:
    """First and one past the last index, 0.02% of the foreground cut from each end."""
    total = np.cumsum(counts)
    slack = int(total[-1] * 2e-4)
    return int(np.searchsorted(total, slack, side="right")), int(np.searchsorted(total, total[-1] - slack)) + 1


def _crop(rgba: Image.Image, box: Box, foreground_ratio: float, size: int) -> Image.Image:
    """The square around a box, resized to (size, size)."""
    square = _square(box, foreground_ratio)
    shrink = (square[2] - square[0]) // (2 * WORK_SIDE)
    if shrink > 1:  # a small ratio makes a square far larger than the image
        rgba = rgba.reduce(shrink)
        left, top, right, bottom = (edge // shrink for edge in box)
        square = _square((left, top, right, bottom), foreground_ratio)
    resampling = Image.Resampling.BOX if square[2] - square[0] >= size else Image.Resampling.BILINEAR
    return rgba.crop(square).resize((size, size), resampling)


def _square(box: Box, foreground_ratio: float) -> Box:
    """The square around the box's centre whose side times `foreground_ratio` is the longer side."""
    left, top, right, bottom = box
    side = max(1, round(max(right - left, bottom - top) / foreground_ratio))
    x, y = (left + right - side) // 2, (top + bottom - side) // 2  # rounds alike wherever the object stands
    return x, y, x + side, y + side
