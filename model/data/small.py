"""Small copies of images."""

from pathlib import Path
from typing import Final

from PIL import Image

from service.files import whole_file

QUALITY: Final = 90  # of JPEG


def store_small(image: Image.Image, shorter_side: int, target: Path) -> None:
    """Store an image as JPEG, its shorter side at most so many pixels."""
    factor = min(1, shorter_side / min(image.size))
    small = image.convert("RGB").resize([max(1, round(length * factor)) for length in image.size])
    with whole_file(target) as file:
        small.save(file, format="JPEG", quality=QUALITY)
