"""Photos that tests draw."""

import io

from PIL import Image, ImageDraw


def image_file(image: Image.Image, kind: str = "PNG", **options: object) -> bytes:
    """The image as a file's bytes."""
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def disc(colour: str = "red", size: tuple[int, int] = (120, 90), at: tuple[int, int] = (40, 30)) -> Image.Image:
    """A disc of 41 pixels on white, its box's corner at `at`."""
    image = Image.new("RGB", size, "white")
    ImageDraw.Draw(image).ellipse((*at, at[0] + 40, at[1] + 40), fill=colour)
    return image
