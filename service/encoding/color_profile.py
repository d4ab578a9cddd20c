"""ICC profiles: colors of a photo -> sRGB."""

import io
from functools import cache
from typing import Final

import numpy as np
from PIL import Image, ImageChops, ImageCms

MODES: Final = {"RGB": "RGB", "GRAY": "L", "CMYK": "CMYK"}  # color space of a profile -> mode of its images
CLASSES: Final = frozenset({"mntr", "scnr", "prtr", "spac"})  # devices and color spaces; not links, not spot colors
ALIKE: Final = 2  # of 255; a profile that changes no color by more is sRGB, up to rounding


def to_srgb(image: Image.Image, profile: bytes) -> Image.Image:
    """Convert an RGB, L or CMYK image to RGB in sRGB.

    The image comes back unchanged if the profile is broken, is for another mode, or is sRGB itself.
    """
    transform = _transform(profile, image.mode)
    return image if transform is None else transform.apply(image)


def changes_colors(profile: bytes, mode: str) -> bool:
    """Return whether `to_srgb` would change an image of this mode."""
    return _transform(profile, mode) is not None


def _transform(profile: bytes, mode: str) -> ImageCms.ImageCmsTransform | None:
    """Return the transform to sRGB, by relative colorimetry; None if there is nothing to change."""
    try:
        source = ImageCms.ImageCmsProfile(io.BytesIO(profile))
        space, device = source.profile.xcolor_space.strip(), source.profile.device_class
        if device not in CLASSES or MODES.get(space) != mode:
            return None
        transform = ImageCms.ImageCmsTransform(
            source,
            ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")),
            mode,
            "RGB",
            ImageCms.Intent.RELATIVE_COLORIMETRIC,
        )
        probe = _probe(mode)
        difference = np.asarray(ImageChops.difference(transform.apply(probe), probe.convert("RGB")))
    except (OSError, ValueError, TypeError, ImageCms.PyCMSError):
        return None
    return transform if difference.max() > ALIKE else None


@cache
def _probe(mode: str) -> Image.Image:
    """Return an image of colors spread over a mode's cube."""
    bands = len(Image.new(mode, (1, 1)).getbands())
    levels = np.linspace(0, 255, 256 if bands == 1 else 9).astype(np.uint8)
    grid = np.stack(np.meshgrid(*[levels] * bands, indexing="ij"), axis=-1)  # (n, ..., n, bands)
    return Image.frombytes(mode, (grid.size // bands, 1), grid.tobytes())
