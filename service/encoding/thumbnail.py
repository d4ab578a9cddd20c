"""A small picture of a photo's object, to be kept with the object and shown beside it."""

import io
from typing import Final

from PIL import Image

THUMBNAIL_SIDE: Final = 160  # pixels
MAX_THUMBNAIL_BYTES: Final = 16_384
QUALITIES: Final = (80, 50, 20)  # of WebP: the first one that keeps to the limit
MEDIA_TYPE: Final = "image/webp"


def thumbnail_file(rgba: Image.Image) -> bytes | None:
    """Return an RGBA image over white as WebP of at most MAX_THUMBNAIL_BYTES; None if it cannot be that small."""
    picture = Image.new("RGB", rgba.size, "white")
    picture.paste(rgba, mask=rgba.getchannel("A"))
    for quality in QUALITIES:
        file = io.BytesIO()
        picture.save(file, "WEBP", quality=quality)
        if file.tell() <= MAX_THUMBNAIL_BYTES:
            return file.getvalue()
    return None
