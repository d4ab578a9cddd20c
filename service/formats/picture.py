"""The file formats of pictures: PNG, and WebP and GIF, which also hold moving ones."""

import io
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image

Bytes = npt.NDArray[np.uint8]

WEBP_QUALITY: Final = 85
GIF_COLORS: Final = 256
GIF_TICK_MS: Final = 10  # the unit of time in GIF files


@dataclass(frozen=True)
class PictureFormat:
    """A file format for pictures.

    name : value of the query parameter `format`.
    media_type : value of Content-Type and Accept.
    extension : of the file's name, with its dot.
    dump : pictures, each (h, w, 3) uint8, RGB, and the milliseconds that each is shown -> the whole file. More than
        one picture repeat forever.
    moves : whether a file holds more than one picture.
    """

    name: str
    media_type: str
    extension: str
    dump: Callable[[Sequence[Bytes], int], bytes]
    moves: bool = True


def _png(pictures: Sequence[Bytes], each_ms: int) -> bytes:
    return _saved(_images(pictures), "PNG", {})


def _webp(pictures: Sequence[Bytes], each_ms: int) -> bytes:
    return _saved(_images(pictures), "WEBP", {"quality": WEBP_QUALITY} | _movement(pictures, each_ms))


def _gif(pictures: Sequence[Bytes], each_ms: int) -> bytes:
    """Write a file with one table of colors, that of all pictures, so that colors stay as the object turns."""
    table = Image.fromarray(np.concatenate(pictures)).quantize(GIF_COLORS)
    images = [image.quantize(palette=table, dither=Image.Dither.NONE) for image in _images(pictures)]
    return _saved(images, "GIF", _movement(pictures, each_ms // GIF_TICK_MS * GIF_TICK_MS))


def _images(pictures: Sequence[Bytes]) -> list[Image.Image]:
    return [Image.fromarray(picture) for picture in pictures]


def _movement(pictures: Sequence[Bytes], each_ms: int) -> dict[str, Any]:
    return {"duration": each_ms, "loop": 0} if len(pictures) > 1 else {}


def _saved(images: Sequence[Image.Image], codec: str, options: Mapping[str, Any]) -> bytes:
    file = io.BytesIO()
    rest = {"save_all": True, "append_images": images[1:]} if len(images) > 1 else {}
    images[0].save(file, codec, **rest, **options)
    return file.getvalue()


PICTURE_FORMATS: Final[Mapping[str, PictureFormat]] = {
    fmt.name: fmt
    for fmt in (
        PictureFormat("png", "image/png", ".png", _png, moves=False),
        PictureFormat("webp", "image/webp", ".webp", _webp),
        PictureFormat("gif", "image/gif", ".gif", _gif),
    )
}
