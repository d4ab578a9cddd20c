"""Bytes of a photo -> an upright RGB or RGBA image, within limits that are checked before pixels are decoded."""

import io
import struct
import warnings
import zlib
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageFile, ImageOps
from PIL.JpegImagePlugin import JpegImageFile
from PIL.PngImagePlugin import PngImageFile
from PIL.WebPImagePlugin import WebPImageFile

from service.errors import CorruptImage, TooLarge, UnsupportedMedia

DEFAULT_MAX_PIXELS: Final = 32_000_000
MAX_SIDE: Final = 65_535
WORK_SIDE: Final = 1024  # pixels of the longest side at which masks and crops are computed

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


def decode(data: bytes, max_pixels: int = DEFAULT_MAX_PIXELS) -> Image.Image:
    """Decode a PNG, JPEG or WebP image, recognized by its content, to an upright RGB or RGBA image.

    Sixteen-bit samples are reduced to eight. Palettes, gray and CMYK become RGB. An animation gives its
    first frame.

    Raises
    ------
    UnsupportedMedia : the bytes are not one of the three types.
    TooLarge : the header announces more than `max_pixels`, or a side above `MAX_SIDE`; no pixel is decoded.
    CorruptImage : the bytes are truncated or corrupt.
    """
    return decode_with_size(data, max_pixels)[0]


def decode_with_size(data: bytes, max_pixels: int) -> tuple[Image.Image, tuple[int, int]]:
    """Decode as `decode` does; return the image and its full size.

    Returns
    -------
    image : upright, RGB or RGBA; a large JPEG is decoded at 1/2, 1/4 or 1/8 of its size.
    size : (width, height) of the upright image in full size, pixels.

    Raises
    ------
    UnsupportedMedia, TooLarge, CorruptImage : as `decode`.
    """
    opener = _opener(data)
    try:
        image = opener(io.BytesIO(data))
        width, height = image.size
        if width * height > max_pixels or max(width, height) > MAX_SIDE:
            raise TooLarge(f"the image has {width} x {height} pixels, the limit is {max_pixels} in all", field="image")
        if isinstance(image, JpegImageFile):
            image.draft("RGB", (WORK_SIDE, WORK_SIDE))
        image.load()
        upright = ImageOps.exif_transpose(image)
        return _to_rgb(upright), (width, height) if upright.size == image.size else (height, width)
    except Image.DecompressionBombError as error:  # Pillow's own limit, checked before it opens a WebP
        raise TooLarge(f"the image has more than {max_pixels} pixels, the limit", field="image") from error
    except _DECODE_ERRORS as error:
        raise CorruptImage("the image is truncated or corrupt", field="image") from error


def ignore_metadata_warnings() -> None:
    """Silence Pillow's warnings in the whole process: they are about the metadata of clients' files."""
    warnings.filterwarnings("ignore", module=r"PIL\.")


def _opener(data: bytes) -> type[ImageFile.ImageFile]:
    """Return Pillow's class for the image type that the first bytes announce. Raises UnsupportedMedia."""
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        return PngImageFile
    if data.startswith(b"\xff\xd8\xff"):
        return JpegImageFile
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return WebPImageFile
    raise UnsupportedMedia("the body is not a PNG, JPEG or WebP image", field="image")


def _to_rgb(image: Image.Image) -> Image.Image:
    """Convert any mode to RGBA if some pixel is transparent, else to RGB."""
    if image.mode.startswith("I"):  # 16-bit gray: convert() would clip, not scale
        return _from_gray16(np.asarray(image).astype(np.int64), image.info.get("transparency"))
    if image.has_transparency_data:
        rgba = image.convert("RGBA")
        low, _ = rgba.getchannel("A").getextrema()
        return rgba if low != 255 else rgba.convert("RGB")
    return image.convert("RGB")


def _from_gray16(values: npt.NDArray[np.int64], transparent: int | None) -> Image.Image:
    """Convert 16-bit gray values (H, W) to RGB, or to RGBA if `transparent` (PNG's tRNS) occurs among them."""
    gray = Image.fromarray((values >> 8).clip(0, 255).astype(np.uint8))
    if transparent is None or not (values == transparent).any():
        return gray.convert("RGB")
    rgba = gray.convert("RGBA")
    rgba.putalpha(Image.fromarray(np.where(values == transparent, 0, 255).astype(np.uint8)))
    return rgba
