"""Transparency: when it is the mask, and where a single value is transparent."""

import struct

import numpy as np
import pytest
from PIL import Image, ImageDraw

from service.encoding.decode import decode
from service.encoding.framing import Framed, Framing, preprocess
from service.errors import InvalidParameter
from tests.support.photos import image_file, png_chunk, png_file

FRAMING = Framing(size=64, foreground_ratio=0.85)
SIZES = [(100, 120), (500, 400), (2000, 1600)]  # one is reduced before its mask is computed


def _photo(size: tuple[int, int], ground: str = "white") -> Image.Image:
    image = Image.new("RGB", size, ground)
    width, height = size
    ImageDraw.Draw(image).rectangle((width // 4, height // 5, width // 2, height * 3 // 4), fill="navy")
    return image


def _with_alpha(image: Image.Image, alpha: Image.Image, hidden: str = "black") -> Image.Image:
    """Return the image with an alpha, and another color wherever it is transparent."""
    result = Image.composite(image, Image.new("RGB", image.size, hidden), alpha.point(lambda level: 255 * (level > 0)))
    result.putalpha(alpha)
    return result


def _one_pixel(size: tuple[int, int]) -> Image.Image:
    alpha = Image.new("L", size, 255)
    alpha.putpixel((size[0] // 3, size[1] // 3), 254)
    return alpha


def _rounded_corners(size: tuple[int, int]) -> Image.Image:
    alpha = Image.new("L", size, 0)
    ImageDraw.Draw(alpha).rounded_rectangle((0, 0, size[0] - 1, size[1] - 1), min(size) // 6, fill=255)
    return alpha


def _thin_frame(size: tuple[int, int]) -> Image.Image:
    alpha = Image.new("L", size, 0)
    alpha.paste(255, (1, 1, size[0] - 1, size[1] - 1))
    return alpha


def _faded(size: tuple[int, int]) -> Image.Image:
    return Image.new("L", size, 200)


ALPHAS = {"one pixel": _one_pixel, "rounded corners": _rounded_corners, "thin frame": _thin_frame, "faded": _faded}


def _framed(image: Image.Image) -> Framed:
    return preprocess(image_file(image, compress_level=1), FRAMING)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("ground", ["white", "silver"])
@pytest.mark.parametrize("hidden", ["black", "white", "red"])
@pytest.mark.parametrize("name", ALPHAS)
def test_preprocess_with_alpha_that_separates_nothing_gives_mask_and_box_of_the_plain_photo(
    size: tuple[int, int], ground: str, hidden: str, name: str
) -> None:
    plain = _photo(size, ground)
    framed, expected = _framed(_with_alpha(plain, ALPHAS[name](size), hidden)), _framed(plain)
    assert (framed.mask, framed.box) == (expected.mask, expected.box) == ("border", expected.box)
    np.testing.assert_allclose(framed.tensor, expected.tensor, atol=0.01)


@pytest.mark.parametrize("name", ALPHAS)
def test_preprocess_of_a_busy_photo_with_alpha_that_separates_nothing_takes_matting(name: str) -> None:
    noise = Image.fromarray(np.random.default_rng(0).integers(0, 255, (120, 100, 3), np.uint8))
    file = image_file(_with_alpha(noise, ALPHAS[name](noise.size)))
    assert preprocess(file, FRAMING).mask == "none"
    with pytest.raises(InvalidParameter, match="cannot be removed"):
        preprocess(file, FRAMING, "remove")
    shapes = []

    def matting(image: Image.Image) -> np.ndarray[tuple[int, ...], np.dtype[np.uint8]]:
        shapes.append((image.mode, image.size))
        return np.full((image.height, image.width), 255, np.uint8)

    assert preprocess(file, FRAMING, matting=matting).mask == "matting"
    assert shapes[0][0] == "RGB"


@pytest.mark.parametrize("size", SIZES)
def test_preprocess_with_a_trimmed_object_takes_its_alpha(size: tuple[int, int]) -> None:
    alpha = Image.new("L", size, 0)
    ImageDraw.Draw(alpha).ellipse((0, 0, size[0] - 1, size[1] - 1), fill=255)
    framed = _framed(_with_alpha(_photo(size), alpha))
    assert framed.mask == "alpha"
    np.testing.assert_allclose(framed.box, (0, 0, *size), atol=max(size) / 250)


# --- a transparent value --------------------------------------------------------------------------


def _packed(values: list[list[int]], depth: int) -> bytes:
    """Return the rows of a gray PNG."""
    rows = []
    for row in values:
        bits = "".join(f"{value:0{depth}b}" for value in row)
        rows.append(b"\0" + int(bits.ljust(-(-len(bits) // 8) * 8, "0"), 2).to_bytes(-(-len(bits) // 8), "big"))
    return b"".join(rows)


@pytest.mark.parametrize("depth", [1, 2, 4, 8, 16])
def test_decode_of_gray_with_a_transparent_value_makes_that_value_transparent(depth: int) -> None:
    high = 2**depth - 1
    values = [[0, high, high - 1] * 5, [high, 0, 1] * 5]
    file = png_file(15, 2, depth, 0, _packed(values, depth), png_chunk(b"tRNS", struct.pack(">H", high)))
    image = decode(file)
    assert image.mode == "RGBA"
    np.testing.assert_array_equal(np.asarray(image)[..., 3], np.where(np.array(values) == high, 0, 255))
    expected = np.array(values) >> 8 if depth == 16 else np.array(values) * 255 // high
    np.testing.assert_array_equal(np.asarray(image)[..., 0], expected)


@pytest.mark.parametrize("depth", [1, 2, 4, 8, 16])
def test_decode_of_gray_without_the_transparent_value_gives_rgb(depth: int) -> None:
    file = png_file(4, 1, depth, 0, _packed([[0] * 4], depth), png_chunk(b"tRNS", struct.pack(">H", 1)))
    assert decode(file).mode == "RGB"


def test_decode_of_8_bit_rgb_with_a_transparent_value_makes_that_value_transparent() -> None:
    rows = b"\0" + bytes([1, 2, 3, 1, 2, 4, 9, 2, 3])
    image = decode(png_file(3, 1, 8, 2, rows, png_chunk(b"tRNS", struct.pack(">3H", 1, 2, 3))))
    assert np.asarray(image)[0].tolist() == [[1, 2, 3, 0], [1, 2, 4, 255], [9, 2, 3, 255]]


def test_decode_of_16_bit_rgb_compares_all_bits_with_the_transparent_value() -> None:
    pixels = [(0x1234, 0x8000, 0xFFFF), (0x1235, 0x8000, 0xFFFF), (0x1334, 0x8000, 0xFFFF)]
    rows = b"\0" + b"".join(struct.pack(">3H", *pixel) for pixel in pixels)
    image = decode(png_file(3, 1, 16, 2, rows, png_chunk(b"tRNS", struct.pack(">3H", *pixels[0]))))
    assert np.asarray(image)[0].tolist() == [[0x12, 0x80, 0xFF, 0], [0x12, 0x80, 0xFF, 255], [0x13, 0x80, 0xFF, 255]]


@pytest.mark.parametrize("depth", [1, 2, 4, 8])
def test_decode_of_a_palette_with_transparency_keeps_its_levels(depth: int) -> None:
    chunks = png_chunk(b"PLTE", bytes([255, 0, 0, 0, 255, 0])), png_chunk(b"tRNS", bytes([77]))
    image = decode(png_file(2, 1, depth, 3, _packed([[0, 1]], depth), *chunks))
    assert np.asarray(image)[0].tolist() == [[255, 0, 0, 77], [0, 255, 0, 255]]


def test_preprocess_of_gray_of_4_bits_gives_the_mask_of_8_bits() -> None:
    values = np.full((32, 32), 15)
    values[4:30, 8:25] = 4
    masks = []
    for depth, scale in ((4, 1), (8, 17)):
        rows = _packed((values * scale).tolist(), depth)
        framed = preprocess(
            png_file(32, 32, depth, 0, rows, png_chunk(b"tRNS", struct.pack(">H", 15 * scale))), FRAMING
        )
        masks.append((framed.mask, framed.box))
    assert masks[0] == masks[1] == ("alpha", (8, 4, 25, 30))
