"""Photos that tests draw."""

import io

from PIL import Image, ImageDraw


def image_file(image: Image.Image, kind: str = "PNG", **options: object) -> bytes:
    """Return the image as a file's bytes."""
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def disc(color: str = "red", size: tuple[int, int] = (120, 90), at: tuple[int, int] = (40, 30)) -> Image.Image:
    """Draw a disc of 41 pixels on white, the corner of its box at `at`."""
    image = Image.new("RGB", size, "white")
    ImageDraw.Draw(image).ellipse((*at, at[0] + 40, at[1] + 40), fill=color)
    return image
