"""Decoded pixels of any mode -> an upright RGB or RGBA image in sRGB, with as few full-size copies as can be.

And what becomes of a photo's square: the encoder's input, and a small picture to be kept with the object.
"""

import io
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageChops

from service.encoding import compiled
from service.encoding.color_profile import changes_colors, to_srgb
from service.encoding.containers.container import ColorKey

WORK_SIDE: Final = 1024  # pixels of the longest side at which masks and crops are computed
THUMBNAIL_SIDE: Final = 160  # pixels
MAX_THUMBNAIL_BYTES: Final = 16_384
QUALITIES: Final = (80, 50, 20)  # of a thumbnail, WebP: the first one that keeps to the limit
STRIP: Final = 256  # rows that are narrowed at a time
TURNS: Final = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_90,
}


def upright_rgb(image: Image.Image, orientation: int, profile: bytes | None) -> Image.Image:
    """Turn an 8-bit image upright and convert it to sRGB: RGBA if some pixel is transparent, else RGB.

    An image whose profile changes its colors is first reduced as framing would reduce it.
    """
    if orientation in TURNS:
        image = image.transpose(TURNS[orientation])
    if image.mode == "P" or image.has_transparency_data:
        image = image.convert("RGBA" if image.has_transparency_data else "RGB")
    if image.mode == "RGBA" and image.getchannel("A").getextrema()[0] == 255:
        image = image.convert("RGB")
    if profile is not None:
        image = _to_srgb(image, profile)
    return image if image.mode in ("RGB", "RGBA") else image.convert("RGB")


def reduction(size: tuple[int, int]) -> int:
    """Return the whole number by which an image of a size is reduced to WORK_SIDE."""
    return max(1, -(-max(size) // WORK_SIDE))


def narrow(image: Image.Image, color_key: ColorKey | None) -> Image.Image:
    """Convert 16-bit gray to 8 bits, which Pillow would clip; to LA if a transparent value is given."""
    gray = np.empty((image.height, image.width), np.uint8)
    alpha = np.empty_like(gray) if color_key else None
    for top in range(0, image.height, STRIP):
        rows = slice(top, min(top + STRIP, image.height))
        values = np.asarray(image.crop((0, rows.start, image.width, rows.stop))).astype(np.int32)
        gray[rows] = (values >> 8).clip(0, 255)
        if alpha is not None and color_key:
            alpha[rows] = np.where(values == color_key[0], 0, 255)
    result = Image.fromarray(gray)
    return result if alpha is None else Image.merge("LA", (result, Image.fromarray(alpha)))


def with_alpha_of(key: ColorKey, depth: int, image: Image.Image, low: Image.Image | None) -> Image.Image:
    """Make one value of an 8-bit gray or RGB image transparent.

    Parameters
    ----------
    key : the transparent value, of `depth` bits.
    low : the lower bytes of 16-bit samples, of which `image` has the higher ones; else None.
    """
    image = image.convert("L") if image.mode == "1" else image
    if low is None:
        alpha = _differs(image, [value * 255 // (2**depth - 1) for value in key])
    else:
        lower = _differs(low, [value & 255 for value in key])
        alpha = ImageChops.lighter(lower, _differs(image, [value >> 8 for value in key]))
    image.putalpha(alpha)
    return image


def _differs(image: Image.Image, key: list[int]) -> Image.Image:
    """Return an L image: 0 where an L or RGB image has exactly this value, else 255."""
    result = Image.new("L", image.size, 0)
    for band, value in enumerate(key):
        differs = image.getchannel(band).point([0 if level == value else 255 for level in range(256)])
        result = ImageChops.lighter(result, differs)
    return result


def _to_srgb(image: Image.Image, profile: bytes) -> Image.Image:
    """Convert an L, 1, RGB, RGBX, RGBA or CMYK image; reduce it if that changes its colors."""
    mode = {"1": "L", "RGBX": "RGB", "RGBA": "RGB"}.get(image.mode, image.mode)
    if not changes_colors(profile, mode):
        return image
    image = image.convert("L") if image.mode == "1" else image
    factor = reduction(image.size)
    image = image.reduce(factor) if factor > 1 else image
    colored = to_srgb(image.convert(mode), profile)
    if image.mode == "RGBA":
        colored.putalpha(image.getchannel("A"))
    return colored


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


def over_white(rgba: Image.Image) -> npt.NDArray[np.float32]:
    """Composite an RGBA image of (size, size) over white: (1, 3, size, size) float32 in [0, 1]."""
    functions = compiled.load()
    if functions is None:
        return _numpy_over_white(rgba)
    rgb = np.empty((1, 3, *rgba.size), np.float32)
    functions.over_white(np.asarray(rgba), rgb[0])
    return rgb


def _numpy_over_white(rgba: Image.Image) -> npt.NDArray[np.float32]:
    """Compute what `over_white` returns, without the compiled functions."""
    planes = b"".join(rgba.tobytes("raw", band) for band in "RGBA")
    pixels = np.frombuffer(planes, np.uint8).reshape(4, *rgba.size)
    levels: npt.NDArray[np.float32] = np.divide(pixels, np.float32(255), dtype=np.float32)
    rgb, alpha = levels[None, :3], levels[3]
    rgb *= alpha
    rgb += 1 - alpha
    return rgb  # (1, 3, size, size)
