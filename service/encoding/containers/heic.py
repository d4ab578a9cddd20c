"""HEIC: EXIF is hidden from the decoder, pillow-heif, which turns the picture itself."""

import importlib
import io
from collections.abc import Callable
from typing import Final

from PIL import ImageFile

from service.encoding.containers.boxes import items
from service.encoding.containers.container import Container
from service.errors import UnsupportedMedia

BRANDS: Final = frozenset({b"heic", b"heix", b"heim", b"heis", b"hevc", b"hevx", b"mif1", b"msf1"})


def read(data: bytes) -> Container:
    """Read the items of a HEIC; its size is known once it is opened. Raises CorruptImage, TooLarge."""
    hidden = bytearray(data)
    for item in items(data):
        if item.kind == b"Exif":
            hidden[item.kind_at : item.kind_at + 4] = b"skip"
    return Container(bytes(hidden), (0, 0), copies=3)


def opener() -> Callable[[io.BytesIO], ImageFile.ImageFile]:
    """Return the class that opens HEIC images. Raises UnsupportedMedia if pillow-heif is not installed."""
    try:
        plugin = importlib.import_module("pillow_heif.as_plugin")
    except ImportError as error:
        raise UnsupportedMedia(
            "HEIC images need the extra `heic` (pillow-heif), which is not installed here: send a JPEG, or "
            "run `pip install '.[heic]'` in the source folder of the service",
            field="image",
        ) from error
    opener: Callable[[io.BytesIO], ImageFile.ImageFile] = plugin.HeifImageFile
    return opener
