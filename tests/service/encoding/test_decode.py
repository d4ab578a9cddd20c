"""Photos of every kind, and files that only claim to be photos."""

import contextlib
import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageFile
from PIL.WebPImagePlugin import WebPImageFile

from service.encoding.decode import decode
from service.encoding.framing import Framing, preprocess
from service.errors import CorruptImage, NoObjectFound, TooLarge, UnsupportedMedia
from tests.support.photos import disc, image_file, png_chunk, png_file

FRAMING = Framing(size=64, foreground_ratio=0.85)


def _near(image: Image.Image, at: tuple[int, int], color: tuple[int, ...], tolerance: int = 0) -> None:
    pixel = np.array(image.getpixel(at), int)
    assert np.abs(pixel - color).max() <= tolerance, pixel


# --- decode ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "tolerance"), [("PNG", 0), ("JPEG", 3), ("WEBP", 3)])
def test_decode_of_each_type_gives_upright_rgb(kind: str, tolerance: int) -> None:
    image = decode(image_file(disc("blue"), kind))
    assert (image.mode, image.size) == ("RGB", (120, 90))
    _near(image, (60, 50), (0, 0, 255), tolerance)
    _near(image, (5, 5), (255, 255, 255), tolerance)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_decode_with_exif_orientation_turns_the_image_upright(kind: str, orientation: int) -> None:
    upright = disc("black", (64, 32), (0, 0)).crop((0, 0, 64, 32))
    transposed = {
        2: Image.Transpose.FLIP_LEFT_RIGHT,
        3: Image.Transpose.ROTATE_180,
        4: Image.Transpose.FLIP_TOP_BOTTOM,
        5: Image.Transpose.TRANSPOSE,
        6: Image.Transpose.ROTATE_90,  # the camera's file: a viewer turns it by 270 degrees
        7: Image.Transpose.TRANSVERSE,
        8: Image.Transpose.ROTATE_270,
    }
    stored = upright.transpose(transposed[orientation]) if orientation > 1 else upright
    exif = Image.Exif()
    exif[0x0112] = orientation
    decoded = decode(image_file(stored, kind, exif=exif, quality=95))
    assert decoded.size == (64, 32)
    np.testing.assert_allclose(np.asarray(decoded, int), np.asarray(upright, int), atol=40)


def test_decode_of_16_bit_gray_keeps_its_high_byte() -> None:
    rows = b"".join(b"\0" + struct.pack(">2H", 0x1234, 0xFFFF) for _ in range(2))
    image = decode(png_file(2, 2, 16, 0, rows))
    assert (image.getpixel((0, 0)), image.getpixel((1, 1))) == ((0x12,) * 3, (0xFF,) * 3)


def test_decode_of_16_bit_rgb_keeps_its_high_bytes() -> None:
    image = decode(png_file(1, 1, 16, 2, b"\0" + struct.pack(">3H", 0x1234, 0x8000, 0xFFFF)))
    assert image.getpixel((0, 0)) == (0x12, 0x80, 0xFF)


def test_decode_of_16_bit_alpha_keeps_it() -> None:
    image = decode(png_file(2, 1, 16, 6, b"\0" + struct.pack(">8H", 0x1234, 0x8000, 0xFFFF, 0x4000, 0, 0, 0, 0xFFFF)))
    assert image.getpixel((0, 0)) == (0x12, 0x80, 0xFF, 0x40)


def test_decode_of_16_bit_gray_with_a_transparent_value_gives_alpha() -> None:
    rows = b"\0" + struct.pack(">2H", 0x1234, 0xFFFF)
    image = decode(png_file(2, 1, 16, 0, rows, png_chunk(b"tRNS", struct.pack(">H", 0xFFFF))))
    assert (image.getpixel((0, 0)), image.getpixel((1, 0))) == ((0x12, 0x12, 0x12, 255), (255, 255, 255, 0))


def test_decode_of_a_palette_with_transparency_gives_alpha() -> None:
    palette = Image.new("P", (4, 4), 0)
    palette.putpalette([255, 0, 0, 0, 255, 0])
    palette.putpixel((1, 1), 1)
    image = decode(image_file(palette, transparency=0))
    assert (image.mode, image.getpixel((0, 0)), image.getpixel((1, 1))) == ("RGBA", (255, 0, 0, 0), (0, 255, 0, 255))


@pytest.mark.parametrize("mode", ["1", "L", "P"])
def test_decode_of_gray_bilevel_and_palette_gives_rgb(mode: str) -> None:
    image = decode(image_file(disc("black").convert(mode)))
    assert image.mode == "RGB"
    _near(image, (60, 50), (0, 0, 0))
    _near(image, (5, 5), (255, 255, 255))


@pytest.mark.parametrize("mode", ["L", "CMYK"])
def test_decode_of_gray_and_cmyk_jpegs_gives_rgb(mode: str) -> None:
    image = decode(image_file(disc("black").convert(mode), "JPEG"))
    assert image.mode == "RGB"
    _near(image, (60, 50), (0, 0, 0), 6)
    _near(image, (5, 5), (255, 255, 255), 6)


def test_decode_of_opaque_alpha_drops_it() -> None:
    assert decode(image_file(disc().convert("RGBA"))).mode == "RGB"


@pytest.mark.parametrize("kind", ["PNG", "WEBP"])
def test_decode_of_an_animation_gives_the_first_frame(kind: str) -> None:
    frames = [Image.new("RGB", (8, 8), color) for color in ("red", "blue")]
    data = image_file(frames[0], kind, save_all=True, append_images=frames[1:])
    _near(decode(data), (4, 4), (255, 0, 0), 3)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x89PNG",
        b"GIF89a",
        image_file(disc(), "GIF"),
        image_file(disc(), "TIFF"),
        image_file(disc(), "BMP"),
        b"<svg/>",
        bytes(99),
    ],
)
def test_decode_of_other_content_raises_unsupported_media(data: bytes) -> None:
    with pytest.raises(UnsupportedMedia):
        decode(data)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_decode_of_a_truncated_file_raises_corrupt_image(kind: str, share: float) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)
    data = image_file(Image.fromarray(noise), kind)
    with pytest.raises(CorruptImage):
        decode(data[: int(len(data) * share)])


@pytest.mark.parametrize("signature", [b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"RIFF\x10\0\0\0WEBP"])
def test_decode_of_a_file_of_another_type_raises_corrupt_image(signature: bytes) -> None:
    for rest in (b"", bytes(100), image_file(disc(), "GIF"), image_file(disc(), "TIFF")):
        with pytest.raises(CorruptImage):
            decode(signature + rest)


@pytest.mark.filterwarnings("ignore")  # Pillow's remarks on broken metadata
@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from(["PNG", "JPEG", "WEBP"]),
    st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), min_size=1, max_size=8),
)
def test_decode_of_a_damaged_file_raises_corrupt_image_or_reads_it(kind: str, damage: list[tuple[float, int]]) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    data = bytearray(image_file(disc(), kind, exif=exif))
    for where, value in damage:
        data[int(where * len(data))] = value
    with contextlib.suppress(CorruptImage, TooLarge, UnsupportedMedia, NoObjectFound):
        preprocess(bytes(data), FRAMING, max_pixels=1_000_000)


def test_decode_of_a_palette_image_without_its_palette_raises_corrupt_image() -> None:
    rows, transparency, palette = b"\0\0", png_chunk(b"tRNS", b"\0"), png_chunk(b"PLTE", bytes(3))
    late = png_file(1, 1, 8, 3, rows, transparency)
    for file in (late, png_file(1, 1, 8, 3, rows), late[:-12] + palette + late[-12:]):
        with pytest.raises(CorruptImage):
            decode(file)


# --- limits ---------------------------------------------------------------------------------------


def _bombs() -> dict[str, bytes]:
    """Return small files whose headers announce huge images."""
    white, jpeg = Image.new("L", (6_000, 6_000), 255), image_file(disc(), "JPEG")
    size = jpeg.index(b"\xff\xc0") + 5  # of the frame: height and width
    return {
        "png": png_file(30_000, 30_000, 8, 2, b""),
        "jpeg": jpeg[:size] + struct.pack(">HH", 20_000, 20_000) + jpeg[size + 4 :],
        "webp": image_file(white.convert("RGB"), "WEBP", method=0),
        "webp beyond Pillow's limit": b"RIFF\x26\0\0\0WEBPVP8X\x0a\0\0\0" + bytes(4) + b"\xff\x3f\0\xff\x3f\0",
        "webp lossless": image_file(white.convert("RGB"), "WEBP", lossless=True, quality=0, method=0),
        "png one line": png_file(2_000_000, 1, 8, 0, b""),
    }


@pytest.fixture(scope="module")
def bombs() -> dict[str, bytes]:
    return _bombs()


@pytest.mark.parametrize("name", ["png", "jpeg", "webp", "webp beyond Pillow's limit", "webp lossless", "png one line"])
def test_decode_of_a_bomb_raises_too_large_from_the_header(
    bombs: dict[str, bytes], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ImageFile.ImageFile, "load", None)  # would fail: nothing may be decoded
    monkeypatch.setattr(WebPImageFile, "load", None)
    limit = 1_000_000 if "line" in name else 32_000_000
    with pytest.raises(TooLarge, match=str(limit)):
        decode(bombs[name], max_pixels=limit)


def test_decode_at_the_limit_is_allowed() -> None:
    data = image_file(disc())  # 120 x 90
    assert decode(data, max_pixels=10_800).size == (120, 90)
    with pytest.raises(TooLarge):
        decode(data, max_pixels=10_799)
