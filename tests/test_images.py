"""Photos of every sort, and files that only claim to be photos."""

import contextlib
import io
import struct
import zlib
from typing import Any

import numpy as np
import pytest
from conftest import disc, encode_image
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageDraw, ImageFile
from PIL.WebPImagePlugin import WebPImageFile

from service.errors import CorruptImage, NoObjectFound, TooLarge, UnsupportedMedia
from service.images import Background, Framing, decode, preprocess

FRAMING = Framing(size=64, foreground_ratio=0.85)


def _file(image: Image.Image, kind: str = "PNG", **options: object) -> bytes:
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _png(width: int, height: int, depth: int, colour_type: int, rows: bytes, *extra: bytes) -> bytes:
    """A PNG from its raw rows, for the modes that Pillow does not write."""
    header = struct.pack(">IIBBBBB", width, height, depth, colour_type, 0, 0, 0)
    chunks = [_chunk(b"IHDR", header), *extra, _chunk(b"IDAT", zlib.compress(rows)), _chunk(b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


def _near(image: Image.Image, at: tuple[int, int], colour: tuple[int, ...], tolerance: int = 0) -> None:
    pixel = np.array(image.getpixel(at), int)
    assert np.abs(pixel - colour).max() <= tolerance, pixel


# --- decode ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(("kind", "tolerance"), [("PNG", 0), ("JPEG", 3), ("WEBP", 3)])
def test_each_type_decodes_to_upright_rgb(kind: str, tolerance: int) -> None:
    image = decode(_file(disc("blue"), kind))
    assert (image.mode, image.size) == ("RGB", (120, 90))
    _near(image, (60, 50), (0, 0, 255), tolerance)
    _near(image, (5, 5), (255, 255, 255), tolerance)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
@pytest.mark.parametrize("orientation", range(1, 9))
def test_exif_orientation_is_undone(kind: str, orientation: int) -> None:
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
    decoded = decode(_file(stored, kind, exif=exif, quality=95))
    assert decoded.size == (64, 32)
    np.testing.assert_allclose(np.asarray(decoded, int), np.asarray(upright, int), atol=40)


def test_sixteen_bit_grey_keeps_its_high_byte() -> None:
    rows = b"".join(b"\0" + struct.pack(">2H", 0x1234, 0xFFFF) for _ in range(2))
    image = decode(_png(2, 2, 16, 0, rows))
    assert (image.getpixel((0, 0)), image.getpixel((1, 1))) == ((0x12,) * 3, (0xFF,) * 3)


def test_sixteen_bit_rgb_keeps_its_high_bytes() -> None:
    image = decode(_png(1, 1, 16, 2, b"\0" + struct.pack(">3H", 0x1234, 0x8000, 0xFFFF)))
    assert image.getpixel((0, 0)) == (0x12, 0x80, 0xFF)


def test_sixteen_bit_alpha_is_kept() -> None:
    image = decode(_png(2, 1, 16, 6, b"\0" + struct.pack(">8H", 0x1234, 0x8000, 0xFFFF, 0x4000, 0, 0, 0, 0xFFFF)))
    assert image.getpixel((0, 0)) == (0x12, 0x80, 0xFF, 0x40)


def test_sixteen_bit_grey_with_a_transparent_value_is_masked() -> None:
    rows = b"\0" + struct.pack(">2H", 0x1234, 0xFFFF)
    image = decode(_png(2, 1, 16, 0, rows, _chunk(b"tRNS", struct.pack(">H", 0xFFFF))))
    assert (image.getpixel((0, 0)), image.getpixel((1, 0))) == ((0x12, 0x12, 0x12, 255), (255, 255, 255, 0))


def test_a_palette_with_transparency_is_masked() -> None:
    palette = Image.new("P", (4, 4), 0)
    palette.putpalette([255, 0, 0, 0, 255, 0])
    palette.putpixel((1, 1), 1)
    image = decode(_file(palette, transparency=0))
    assert (image.mode, image.getpixel((0, 0)), image.getpixel((1, 1))) == ("RGBA", (255, 0, 0, 0), (0, 255, 0, 255))


@pytest.mark.parametrize("mode", ["1", "L", "P"])
def test_grey_bilevel_and_palette_become_rgb(mode: str) -> None:
    image = decode(_file(disc("black").convert(mode)))
    assert image.mode == "RGB"
    _near(image, (60, 50), (0, 0, 0))
    _near(image, (5, 5), (255, 255, 255))


@pytest.mark.parametrize("mode", ["L", "CMYK"])
def test_grey_and_cmyk_jpegs_become_rgb(mode: str) -> None:
    image = decode(_file(disc("black").convert(mode), "JPEG"))
    assert image.mode == "RGB"
    _near(image, (60, 50), (0, 0, 0), 6)
    _near(image, (5, 5), (255, 255, 255), 6)


def test_opaque_alpha_is_dropped() -> None:
    assert decode(_file(disc().convert("RGBA"))).mode == "RGB"


@pytest.mark.parametrize("kind", ["PNG", "WEBP"])
def test_of_an_animation_the_first_frame_counts(kind: str) -> None:
    frames = [Image.new("RGB", (8, 8), colour) for colour in ("red", "blue")]
    data = _file(frames[0], kind, save_all=True, append_images=frames[1:])
    _near(decode(data), (4, 4), (255, 0, 0), 3)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x89PNG",
        b"GIF89a",
        _file(disc(), "GIF"),
        _file(disc(), "TIFF"),
        _file(disc(), "BMP"),
        b"<svg/>",
        bytes(99),
    ],
)
def test_other_types_are_refused_by_content(data: bytes) -> None:
    with pytest.raises(UnsupportedMedia):
        decode(data)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_truncated_files_are_refused(kind: str, share: float) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)
    data = _file(Image.fromarray(noise), kind)
    with pytest.raises(CorruptImage):
        decode(data[: int(len(data) * share)])


@pytest.mark.parametrize("signature", [b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff", b"RIFF\x10\0\0\0WEBP"])
def test_a_file_that_lies_about_its_type_is_corrupt(signature: bytes) -> None:
    for rest in (b"", bytes(100), _file(disc(), "GIF"), _file(disc(), "TIFF")):
        with pytest.raises(CorruptImage):
            decode(signature + rest)


@pytest.mark.filterwarnings("ignore")  # Pillow's remarks on broken metadata
@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from(["PNG", "JPEG", "WEBP"]),
    st.lists(st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 255)), min_size=1, max_size=8),
)
def test_damage_is_an_error_of_ours_or_harmless(kind: str, damage: list[tuple[float, int]]) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    data = bytearray(_file(disc(), kind, exif=exif))
    for where, value in damage:
        data[int(where * len(data))] = value
    with contextlib.suppress(CorruptImage, TooLarge, UnsupportedMedia, NoObjectFound):
        preprocess(bytes(data), FRAMING, max_pixels=1_000_000)


# --- limits ---------------------------------------------------------------------------------------


def _bombs() -> dict[str, bytes]:
    """Small files whose headers announce much."""
    white = Image.new("L", (6_000, 6_000), 255)
    return {
        "png": _png(30_000, 30_000, 8, 2, b""),
        "jpeg": _file(white, "JPEG"),
        "webp": _file(white.convert("RGB"), "WEBP", method=0),
        "webp beyond Pillow's limit": b"RIFF\x26\0\0\0WEBPVP8X\x0a\0\0\0" + bytes(4) + b"\xff\x3f\0\xff\x3f\0",
        "webp lossless": _file(white.convert("RGB"), "WEBP", lossless=True, quality=0, method=0),
        "png one line": _png(2_000_000, 1, 8, 0, b""),
    }


@pytest.fixture(scope="module")
def bombs() -> dict[str, bytes]:
    return _bombs()


@pytest.mark.parametrize("name", ["png", "jpeg", "webp", "webp beyond Pillow's limit", "webp lossless", "png one line"])
def test_bombs_are_refused_from_their_headers(
    bombs: dict[str, bytes], name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ImageFile.ImageFile, "load", None)  # would fail: nothing may be decoded
    monkeypatch.setattr(WebPImageFile, "load", None)
    limit = 1_000_000 if "line" in name else 32_000_000
    with pytest.raises(TooLarge, match=str(limit)):
        decode(bombs[name], max_pixels=limit)


def test_the_limit_itself_is_allowed() -> None:
    data = _file(disc())  # 120 x 90
    assert decode(data, max_pixels=10_800).size == (120, 90)
    with pytest.raises(TooLarge):
        decode(data, max_pixels=10_799)


# --- framing --------------------------------------------------------------------------------------


def _object_span(tensor: np.ndarray[Any, Any]) -> tuple[int, int, int, int]:
    """left, top, right, bottom of what is not white in an encoder's input."""
    rows, columns = np.nonzero((tensor[0] < 0.5).any(axis=0))
    return int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1


def test_the_tensor_is_what_an_encoder_takes() -> None:
    framed = preprocess(_file(disc()), FRAMING)
    assert framed.tensor.shape == (1, 3, 64, 64)
    assert framed.tensor.dtype == np.float32
    assert framed.tensor.flags.c_contiguous
    assert 0 <= framed.tensor.min() <= framed.tensor.max() <= 1
    np.testing.assert_array_equal(framed.tensor[0, :, 0, 0], 1)  # white ground
    np.testing.assert_array_equal(framed.tensor[0, :, 32, 32], [1, 0, 0])  # red disc


def test_a_uniform_border_is_the_background() -> None:
    framed = preprocess(_file(disc()), FRAMING)
    assert (framed.mask, framed.box, framed.width, framed.height) == ("border", (40, 30, 81, 71), 120, 90)


@pytest.mark.parametrize("ground", ["white", "black", "#7080a0"])
def test_the_ground_becomes_white_whatever_it_was(ground: str) -> None:
    image = Image.new("RGB", (100, 100), ground)
    ImageDraw.Draw(image).rectangle((30, 30, 69, 69), fill="red")
    np.testing.assert_array_equal(preprocess(_file(image), FRAMING).tensor[0, :, 0, 0], 1)


def test_alpha_is_the_mask_and_wins_over_the_border() -> None:
    image = Image.new("RGBA", (100, 80), (255, 255, 255, 0))
    ImageDraw.Draw(image).rectangle((20, 10, 79, 39), fill=(255, 255, 255, 255))  # white on white: alpha alone tells
    ImageDraw.Draw(image).rectangle((40, 20, 49, 29), fill=(0, 0, 0, 255))
    framed = preprocess(_file(image), FRAMING)
    assert (framed.mask, framed.box) == ("alpha", (20, 10, 80, 40))


def test_what_is_transparent_never_shows() -> None:
    images = []
    for hidden in ("red", "black"):
        image = Image.new("RGB", (80, 80), hidden)
        ImageDraw.Draw(image).ellipse((20, 20, 59, 59), fill="blue")
        mask = Image.new("L", (80, 80), 0)
        ImageDraw.Draw(mask).ellipse((20, 20, 59, 59), fill=255)
        image.putalpha(mask)
        images.append(preprocess(_file(image), FRAMING).tensor)
    np.testing.assert_allclose(images[0], images[1], atol=0.02)


@pytest.mark.parametrize("ratio", [0.1, 0.5, 0.85, 1.0])
def test_the_longer_side_takes_the_foreground_ratio(ratio: float) -> None:
    image = Image.new("RGB", (300, 200), "white")
    ImageDraw.Draw(image).rectangle((50, 60, 209, 99), fill="black")  # 160 x 40
    left, top, right, bottom = _object_span(preprocess(_file(image), Framing(64, ratio)).tensor)
    assert abs((right - left) - 64 * ratio) <= 2
    assert abs((bottom - top) - 64 * ratio / 4) <= 2
    assert abs((left + right) / 2 - 32) <= 1
    assert abs((top + bottom) / 2 - 32) <= 1


@settings(max_examples=40, deadline=None)
@given(st.integers(3, 117), st.integers(3, 57))
def test_framing_does_not_see_where_the_object_stands(x: int, y: int) -> None:
    centred = preprocess(_file(disc("red", (161, 101), (60, 30))), FRAMING)
    moved = preprocess(_file(disc("red", (161, 101), (x, y))), FRAMING)
    np.testing.assert_array_equal(moved.tensor, centred.tensor)
    assert moved.box == (x, y, x + 41, y + 41)


def test_framing_does_not_see_how_large_the_photo_is() -> None:
    small = preprocess(_file(disc()), FRAMING).tensor
    padded = preprocess(_file(disc("red", (600, 500), (40, 30))), FRAMING).tensor
    np.testing.assert_array_equal(padded, small)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
def test_large_photos_are_reported_in_their_own_pixels(kind: str) -> None:
    image = Image.new("RGB", (4000, 3000), "white")
    ImageDraw.Draw(image).rectangle((1000, 600, 2999, 2399), fill="navy")
    framed = preprocess(_file(image, kind), FRAMING)
    assert (framed.width, framed.height) == (4000, 3000)
    np.testing.assert_allclose(framed.box, (1000, 600, 3000, 2400), atol=8)


def test_a_small_share_makes_no_huge_crop(monkeypatch: pytest.MonkeyPatch) -> None:
    image = Image.new("RGBA", (1024, 1024), "black")
    image.putpixel((0, 0), (0, 0, 0, 0))
    cropped = []
    original = Image.Image.crop

    def crop(self: Image.Image, box: tuple[int, int, int, int]) -> Image.Image:
        cropped.append(box)
        return original(self, box)

    monkeypatch.setattr(Image.Image, "crop", crop)
    left, top, right, bottom = _object_span(preprocess(_file(image), Framing(64, 0.1)).tensor)
    assert abs((right - left) - 6.4) <= 1.6
    assert abs((left + right) / 2 - 32) <= 1
    assert (bottom - top, top) == (right - left, left)
    ((x0, _, x1, _),) = cropped
    assert x1 - x0 < 4096


def test_keep_takes_the_whole_image() -> None:
    framed = preprocess(_file(disc("red", (120, 60), (40, 10))), FRAMING, "keep")
    assert (framed.mask, framed.box) == ("none", (0, 0, 120, 60))
    left, top, right, bottom = _object_span(framed.tensor)
    assert abs((right - left) - 64 * 41 / 120) <= 2
    assert abs((bottom - top) - 64 * 41 / 120) <= 2


@pytest.mark.parametrize("background", ["auto", "remove"])
@pytest.mark.parametrize(
    "image",
    [
        Image.new("RGB", (64, 64), "white"),
        Image.new("RGB", (1, 1), "red"),
        Image.new("RGBA", (64, 64), (255, 0, 0, 0)),
    ],
    ids=["blank", "1x1", "transparent"],
)
def test_no_object_is_said_so(image: Image.Image, background: Background) -> None:
    with pytest.raises(NoObjectFound):
        preprocess(_file(image), FRAMING, background)


def test_one_pixel_that_is_kept_fills_the_input() -> None:
    framed = preprocess(_file(Image.new("RGB", (1, 1), "red")), FRAMING, "keep")
    assert framed.box == (0, 0, 1, 1)
    np.testing.assert_array_equal(framed.tensor[0, 0], 1)
    np.testing.assert_array_equal(framed.tensor[0, 1:], 0)


def test_a_busy_border_leaves_the_image_whole_and_cannot_be_removed() -> None:
    noise = Image.fromarray(np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8))
    assert preprocess(encode_image(noise), FRAMING).mask == "none"
    with pytest.raises(NoObjectFound, match="cannot be removed"):
        preprocess(encode_image(noise), FRAMING, "remove")
