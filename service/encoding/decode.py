"""Bytes of a photo -> an upright RGB or RGBA image, within limits that are checked before pixels are decoded."""

import importlib
import io
import struct
import threading
import warnings
import zlib
from collections.abc import Callable
from concurrent.futures import CancelledError
from dataclasses import dataclass
from typing import Any, Final

from PIL import Image, ImageChops, ImageFile, features
from PIL.JpegImagePlugin import JpegImageFile
from PIL.PngImagePlugin import PngImageFile
from PIL.WebPImagePlugin import WebPImageFile

from service.encoding.containers import avif, boxes, heic, jpeg, png, webp
from service.encoding.containers.container import Container
from service.encoding.containers.exif import orientation_of
from service.encoding.pixels import WORK_SIDE, narrow, upright_rgb, with_alpha_of
from service.errors import CorruptImage, TooLarge, UnsupportedMedia

DEFAULT_MAX_PIXELS: Final = 32_000_000
MAX_SIDE: Final = 65_535
WORKING_BYTES: Final = 12  # for each pixel of the limit: the most that decoding may take
REDUCED: Final = 8  # a JPEG may have that many times the pixels of the limit, since it is decoded at a part of its size
MAX_PASSES: Final = 25  # samples that the scans of a JPEG may visit for each pixel of the limit; libjpeg's CMYK: 24
BLOCK_BYTES: Final = 8_192  # of a file, that are decoded before the next look whether to stop
# For a JPEG that lacks its end marker: libjpeg goes on with zeros, or finds a one where it still needs a bit.
TAILS: Final = (b"\xff\xd9", b"\xb6\xdb\x6d" * 21 + b"\xff\xd9")
LIMIT: Final = "HOF_MAX_IMAGE_PIXELS, --max-image-pixels"

_DECODE_ERRORS = (
    OSError,
    SyntaxError,
    ValueError,
    IndexError,
    KeyError,
    EOFError,
    OverflowError,
    RuntimeError,  # pillow-heif's
    AssertionError,  # Pillow's, about the bytes
    struct.error,
    zlib.error,
)


@dataclass(frozen=True)
class _Type:
    """An image type: the reader of its container, and Pillow's class for it."""

    read: Callable[[bytes], Container]
    open: Callable[[io.BytesIO], ImageFile.ImageFile]


def decode(data: bytes, max_pixels: int = DEFAULT_MAX_PIXELS) -> Image.Image:
    """Decode a PNG, JPEG, WebP, AVIF or HEIC image, recognized by its content, to an upright RGB or RGBA image.

    Sixteen-bit samples are reduced to eight. Palettes, gray and CMYK become RGB; colors of an ICC profile become
    sRGB. An animation gives its first frame. Metadata that is damaged is ignored.

    Raises
    ------
    UnsupportedMedia : the bytes are not one of these types, or its decoder is not installed.
    TooLarge : the header announces more than `max_pixels`, a side above `MAX_SIDE`, or more scans, parts or memory
        than such an image may take; no pixel is decoded. A JPEG may have 8 times as many pixels.
    CorruptImage : the bytes are truncated or corrupt.
    """
    return decode_with_size(data, max_pixels)[0]


def decode_with_size(
    data: bytes, max_pixels: int, stop: threading.Event | None = None
) -> tuple[Image.Image, tuple[int, int]]:
    """Decode as `decode` does; return the image and its full size.

    Returns
    -------
    image : upright, RGB or RGBA; large JPEGs, and images whose colors are converted, at a part of their size.
    size : (width, height) of the upright image in full size, pixels.

    Raises
    ------
    UnsupportedMedia, TooLarge, CorruptImage : as `decode`.
    concurrent.futures.CancelledError : `stop` was set meanwhile.
    """
    kind = _type_of(data)
    check_stop(stop)
    try:
        container = kind.read(data)
        check_stop(stop)
        image, info = _pixels(kind, container, max_pixels, stop)
        orientation = orientation_of(info.get("exif", b"")) if kind.read is avif.read else container.orientation
        image = upright_rgb(image, orientation, container.profile or info.get("icc_profile"))
    except Image.DecompressionBombError as error:  # Pillow's own limit, checked before it opens a WebP
        raise TooLarge(f"the image has more than {max_pixels} pixels, the limit ({LIMIT})", field="image") from error
    except _DECODE_ERRORS as error:
        raise CorruptImage("the image is truncated or corrupt", field="image") from error
    width, height = info["size"]
    return image, (width, height) if orientation < 5 else (height, width)


def check_stop(stop: threading.Event | None) -> None:
    """Raise CancelledError if work is to stop."""
    if stop is not None and stop.is_set():
        raise CancelledError


def configure_pillow() -> None:
    """Set what Pillow keeps for the whole process: no warnings about clients' metadata, no threads of its own."""
    warnings.filterwarnings("ignore", module=r"PIL\.")
    if features.check("avif"):
        _avif_plugin().DEFAULT_MAX_THREADS = 1


def _avif_plugin() -> Any:  # noqa: ANN401 - a module that older versions of Pillow lack
    return importlib.import_module("PIL.AvifImagePlugin")


class _Source(io.BytesIO):
    """A file in memory whose reader is stopped by an event."""

    def __init__(self, data: bytes, stop: threading.Event | None) -> None:
        super().__init__(data)
        self._stop = stop

    def read(self, size: int | None = -1) -> bytes:
        check_stop(self._stop)
        return super().read(size)


def _type_of(data: bytes) -> _Type:
    """Return the image type that the first bytes announce. Raises UnsupportedMedia."""
    if data.startswith(png.SIGNATURE):
        return _Type(png.read, PngImageFile)
    if data.startswith(b"\xff\xd8\xff"):
        return _Type(jpeg.read, JpegImageFile)
    if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
        return _Type(webp.read, WebPImageFile)
    brands = boxes.brands(data)
    if avif.BRANDS & brands:
        if not features.check("avif"):
            raise UnsupportedMedia("AVIF is not supported here: it needs Pillow 11.3 or newer", field="image")
        return _Type(avif.read, _avif_plugin().AvifImageFile)
    if heic.BRANDS & brands:
        return _Type(heic.read, heic.opener())
    raise UnsupportedMedia("the body is not a PNG, JPEG, WebP, AVIF or HEIC image", field="image")


def _pixels(
    kind: _Type, container: Container, max_pixels: int, stop: threading.Event | None
) -> tuple[Image.Image, dict[Any, Any]]:
    """Decode to 8 bits, transparency included; return the image, and Pillow's `info` with the full `size`.

    Raises
    ------
    CorruptImage : a JPEG without an end marker lacks data: it changes with what is put in their place.
    """
    file = _open(kind, container, max_pixels, stop, TAILS[0] if container.is_cut else b"")
    info = {**file.info, "size": file.size}
    image = _load(file, container, max_pixels)
    if container.is_cut:
        other = _load(_open(kind, container, max_pixels, stop, TAILS[1]), container, max_pixels)
        if ImageChops.difference(image, other).getbbox() is not None:
            raise CorruptImage("the image is truncated", field="image")
    if image.mode.startswith("I"):
        image = narrow(image, container.color_key)
    elif container.color_key:
        low = None
        if container.depth == 16:
            low = _open(kind, container, max_pixels, stop)
            low.tile = [low.tile[0]._replace(args="RGB;16L")]  # of each sample, the byte that Pillow leaves out
        image = with_alpha_of(container.color_key, container.depth, image, low)
    return image, info


def _open(
    kind: _Type, container: Container, max_pixels: int, stop: threading.Event | None, tail: bytes = b""
) -> ImageFile.ImageFile:
    """Read the header of an image, and check it. Raises TooLarge."""
    _check_size(kind, container.size, max_pixels)
    file = kind.open(_Source(container.data + tail, stop))
    file.decodermaxblock = BLOCK_BYTES
    _check_size(kind, file.size, max_pixels)
    if container.passes > MAX_PASSES * max_pixels:
        raise TooLarge(
            f"the JPEG's scans visit {container.passes} samples, the limit is {MAX_PASSES * max_pixels} ({LIMIT}): "
            "save it anew",
            field="image",
        )
    return file


def _check_size(kind: _Type, size: tuple[int, int], max_pixels: int) -> None:
    width, height = size
    factor = REDUCED if kind.read is jpeg.read else 1
    if width * height > factor * max_pixels or max(size) > MAX_SIDE:
        raise TooLarge(
            f"the image has {width} x {height} pixels, the limit is {max_pixels} ({LIMIT}), {REDUCED} times that for a "
            f"JPEG, and {MAX_SIDE} a side: make it smaller, or raise the limit",
            field="image",
        )


def _load(file: ImageFile.ImageFile, container: Container, max_pixels: int) -> Image.Image:
    """Decode the pixels, to 8 bits. Raises TooLarge for more memory than the limit in pixels stands for."""
    if isinstance(file, JpegImageFile):
        _reduce(file, max_pixels)
    needed = container.buffered_bytes + 4 * container.copies * file.width * file.height
    if needed > WORKING_BYTES * max_pixels:
        raise TooLarge(
            f"decoding the image takes {needed} bytes, the limit is {WORKING_BYTES * max_pixels}, {WORKING_BYTES} for "
            f"each pixel ({LIMIT}): make it smaller, or save it anew",
            field="image",
        )
    image = _frame(file) if hasattr(file, "_decoder") else file
    image.load()
    return image


def _reduce(file: JpegImageFile, max_pixels: int) -> None:
    """Have a JPEG decoded at 1/2, 1/4 or 1/8 of its size: if the shorter side is long enough, or to fit the limit."""
    width, height = file.size
    scale = 1 << (min(8, max(1, min(file.size) // WORK_SIDE)).bit_length() - 1)
    while width * height > max_pixels * scale**2:
        scale *= 2
    file.draft("RGB", (width // scale, height // scale))


def _frame(file: Any) -> Image.Image:  # noqa: ANN401 - WebP's and AVIF's class, by Pillow's decoder
    """Decode the first frame of a WebP or AVIF.

    Pillow's own way keeps the decoder, with two canvases of its own, until the pixels are copied twice more.
    """
    decoder, file._decoder = file._decoder, None
    is_webp = isinstance(file, WebPImageFile)
    frame = decoder.get_next() if is_webp else decoder.get_frame(0)
    if frame is None:
        raise EOFError("no frame")
    del decoder
    mode = file.rawmode if is_webp else file.mode
    return Image.frombuffer(mode, file.size, frame[0], "raw", mode, 0, 1)
