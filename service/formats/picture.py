"""The file formats of pictures: PNG and WebP."""

import io
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image

Bytes = npt.NDArray[np.uint8]

WEBP_QUALITY: Final = 85


@dataclass(frozen=True)
class PictureFormat:
    """A file format for pictures.

    name : value of the query parameter `format`.
    media_type : value of Content-Type and Accept.
    extension : of the file's name, with its dot.
    dump : picture (h, w, 3) uint8, RGB -> the whole file.
    """

    name: str
    media_type: str
    extension: str
    dump: Callable[[Bytes], bytes]


def _dump(codec: str, options: Mapping[str, Any], picture: Bytes) -> bytes:
    file = io.BytesIO()
    Image.fromarray(picture).save(file, codec, **options)
    return file.getvalue()


PICTURE_FORMATS: Final[Mapping[str, PictureFormat]] = {
    fmt.name: fmt
    for fmt in (
        PictureFormat("png", "image/png", ".png", partial(_dump, "PNG", {})),
        PictureFormat("webp", "image/webp", ".webp", partial(_dump, "WEBP", {"quality": WEBP_QUALITY})),
    )
}
