"""Framing: the part of a photo that an encoder sees, and how it is reported."""

import io
from functools import partial
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image, ImageDraw

from service.encoding.framing import Background, Box, Framing, _within, preprocess
from service.encoding.masks import TRACE
from service.errors import InvalidParameter, NoObjectFound
from tests.support.photos import disc, image_file

FRAMING = Framing(size=64, foreground_ratio=0.85)


def _object_span(tensor: np.ndarray[Any, Any]) -> tuple[int, int, int, int]:
    """Return left, top, right, bottom of the pixels that are not white in an encoder's input."""
    rows, columns = np.nonzero((tensor[0] < 0.5).any(axis=0))
    return int(columns.min()), int(rows.min()), int(columns.max()) + 1, int(rows.max()) + 1


def test_preprocess_gives_the_tensor_an_encoder_takes() -> None:
    framed = preprocess(image_file(disc()), FRAMING)
    assert framed.tensor.shape == (1, 3, 64, 64)
    assert framed.tensor.dtype == np.float32
    assert framed.tensor.flags.c_contiguous
    assert 0 <= framed.tensor.min() <= framed.tensor.max() <= 1
    np.testing.assert_array_equal(framed.tensor[0, :, 0, 0], 1)  # white ground
    np.testing.assert_array_equal(framed.tensor[0, :, 32, 32], [1, 0, 0])  # red disc


def test_preprocess_with_a_uniform_border_takes_it_as_background() -> None:
    framed = preprocess(image_file(disc()), FRAMING)
    assert (framed.mask, framed.box, framed.width, framed.height) == ("border", (40, 30, 81, 71), 120, 90)


@pytest.mark.parametrize("ground", ["white", "black", "#7080a0"])
def test_preprocess_of_any_background_color_gives_white(ground: str) -> None:
    image = Image.new("RGB", (100, 100), ground)
    ImageDraw.Draw(image).rectangle((30, 30, 69, 69), fill="red")
    np.testing.assert_array_equal(preprocess(image_file(image), FRAMING).tensor[0, :, 0, 0], 1)


def test_preprocess_with_alpha_prefers_it_to_the_border() -> None:
    image = Image.new("RGBA", (100, 80), (255, 255, 255, 0))
    ImageDraw.Draw(image).rectangle((20, 10, 79, 39), fill=(255, 255, 255, 255))  # white on white: alpha alone tells
    ImageDraw.Draw(image).rectangle((40, 20, 49, 29), fill=(0, 0, 0, 255))
    framed = preprocess(image_file(image), FRAMING)
    assert (framed.mask, framed.box) == ("alpha", (20, 10, 80, 40))


def test_preprocess_hides_transparent_pixels() -> None:
    images = []
    for hidden in ("red", "black"):
        image = Image.new("RGB", (80, 80), hidden)
        ImageDraw.Draw(image).ellipse((20, 20, 59, 59), fill="blue")
        mask = Image.new("L", (80, 80), 0)
        ImageDraw.Draw(mask).ellipse((20, 20, 59, 59), fill=255)
        image.putalpha(mask)
        images.append(preprocess(image_file(image), FRAMING).tensor)
    np.testing.assert_allclose(images[0], images[1], atol=0.02)


@pytest.mark.parametrize("ratio", [0.1, 0.5, 0.85, 1.0])
def test_preprocess_scales_the_longer_side_to_the_foreground_ratio(ratio: float) -> None:
    image = Image.new("RGB", (300, 200), "white")
    ImageDraw.Draw(image).rectangle((50, 60, 209, 99), fill="black")  # 160 x 40
    left, top, right, bottom = _object_span(preprocess(image_file(image), Framing(64, ratio)).tensor)
    assert abs((right - left) - 64 * ratio) <= 2
    assert abs((bottom - top) - 64 * ratio / 4) <= 2
    assert abs((left + right) / 2 - 32) <= 1
    assert abs((top + bottom) / 2 - 32) <= 1


@settings(max_examples=40, deadline=None)
@given(st.integers(3, 117), st.integers(3, 57))
def test_preprocess_of_a_moved_object_gives_the_same_tensor(x: int, y: int) -> None:
    centered = preprocess(image_file(disc("red", (161, 101), (60, 30))), FRAMING)
    moved = preprocess(image_file(disc("red", (161, 101), (x, y))), FRAMING)
    np.testing.assert_array_equal(moved.tensor, centered.tensor)
    assert moved.box == (x, y, x + 41, y + 41)


def test_preprocess_of_a_larger_photo_gives_the_same_tensor() -> None:
    small = preprocess(image_file(disc()), FRAMING).tensor
    padded = preprocess(image_file(disc("red", (600, 500), (40, 30))), FRAMING).tensor
    np.testing.assert_array_equal(padded, small)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
def test_preprocess_of_large_photos_reports_their_own_pixels(kind: str) -> None:
    image = Image.new("RGB", (4000, 3000), "white")
    ImageDraw.Draw(image).rectangle((1000, 600, 2999, 2399), fill="navy")
    framed = preprocess(image_file(image, kind), FRAMING)
    assert (framed.width, framed.height) == (4000, 3000)
    np.testing.assert_allclose(framed.box, (1000, 600, 3000, 2400), atol=8)


@pytest.mark.parametrize(("alpha", "confidence"), [(255, 1.0), (102, 0.4)])
def test_confidence_of_a_matte_is_its_mean_weighted_by_itself(alpha: int, confidence: float) -> None:
    image = Image.new("RGBA", (100, 80), (255, 0, 0, 0))
    ImageDraw.Draw(image).rectangle((20, 10, 79, 39), fill=(0, 0, 255, alpha))
    assert preprocess(image_file(image), FRAMING).confidence == pytest.approx(confidence)


def test_confidence_without_a_mask_is_none() -> None:
    assert preprocess(image_file(disc()), FRAMING, "keep").confidence is None


def test_preprocess_with_a_small_ratio_makes_no_huge_crop(monkeypatch: pytest.MonkeyPatch) -> None:
    image = Image.new("RGBA", (1024, 1024), (0, 0, 0, 0))
    ImageDraw.Draw(image).ellipse((0, 0, 1023, 1023), fill="black")
    cropped = []
    original = Image.Image.crop

    def crop(self: Image.Image, box: tuple[int, int, int, int]) -> Image.Image:
        cropped.append(box)
        return original(self, box)

    monkeypatch.setattr(Image.Image, "crop", crop)
    left, top, right, bottom = _object_span(preprocess(image_file(image), Framing(64, 0.1)).tensor)
    assert abs((right - left) - 6.4) <= 1.6
    assert abs((left + right) / 2 - 32) <= 1
    assert (bottom - top, top) == (right - left, left)
    ((x0, _, x1, _),) = cropped
    assert x1 - x0 < 4096


def test_preprocess_with_background_keep_takes_the_whole_image() -> None:
    framed = preprocess(image_file(disc("red", (120, 60), (40, 10))), FRAMING, "keep")
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
def test_preprocess_without_an_object_raises_no_object_found(image: Image.Image, background: Background) -> None:
    with pytest.raises(NoObjectFound):
        preprocess(image_file(image), FRAMING, background)


def test_preprocess_of_one_pixel_fills_the_input() -> None:
    framed = preprocess(image_file(Image.new("RGB", (1, 1), "red")), FRAMING, "keep")
    assert framed.box == (0, 0, 1, 1)
    np.testing.assert_array_equal(framed.tensor[0, 0], 1)
    np.testing.assert_array_equal(framed.tensor[0, 1:], 0)


def test_preprocess_with_a_busy_border_takes_the_image_whole_or_raises() -> None:
    noise = Image.fromarray(np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8))
    assert preprocess(image_file(noise), FRAMING).mask == "none"
    with pytest.raises(InvalidParameter, match="cannot be removed"):
        preprocess(image_file(noise), FRAMING, "remove")


# --- in front of any background: a trace of what a mask removes, and no margin ---------------------------


def _middle(image: Image.Image) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    """Take the middle half of a picture for the object."""
    matte = np.zeros((image.height, image.width), np.uint8)
    matte[:, image.width // 4 : 3 * image.width // 4] = 255
    return matte


def _colors(size: tuple[int, int]) -> Image.Image:
    """Return a picture without a uniform border, and without white."""
    return Image.fromarray(np.random.default_rng(0).integers(0, 200, (size[1], size[0], 3)).astype(np.uint8))


def test_preprocess_by_matting_leaves_a_trace_of_what_it_removes() -> None:
    photo = _colors((64, 64))
    tensor = preprocess(image_file(photo), FRAMING, matting=_middle).tensor[0].transpose(1, 2, 0)
    levels = np.asarray(photo) / 255
    np.testing.assert_allclose(tensor[:, 16:48], levels[:, 16:48], atol=1e-6)
    trace = 1 - TRACE / 255 * (1 - levels[:, 48:])
    np.testing.assert_allclose(tensor[:, 48:], trace, atol=1.01 / 255)
    assert trace.max() < 1


def test_preprocess_by_matting_leaves_no_trace_of_transparent_pixels() -> None:
    photo = _colors((64, 64)).convert("RGBA")
    photo.putpixel((63, 0), (0, 0, 0, 0))
    tensor = preprocess(image_file(photo), FRAMING, matting=_middle).tensor[0]
    assert (tensor[:, 0, 63] == 1).all()
    assert (tensor[:, 1:, 63] < 1).all()


def test_preprocess_by_matting_keeps_the_object_of_a_half_transparent_photo() -> None:
    photo = _colors((64, 64))
    opaque = preprocess(image_file(photo), FRAMING, matting=_middle).tensor
    photo.putalpha(100)
    half = preprocess(image_file(photo), FRAMING, matting=_middle).tensor
    np.testing.assert_allclose(half[..., 16:48], opaque[..., 16:48], atol=1e-6)


def test_preprocess_by_matting_keeps_no_trace_in_the_thumbnail() -> None:
    thumbnail = preprocess(image_file(_colors((64, 64))), FRAMING, matting=_middle, thumbnail=True).thumbnail
    assert thumbnail is not None
    levels = np.asarray(Image.open(io.BytesIO(thumbnail)).convert("RGB"))
    assert (levels[:, 130:] >= 253).all()
    assert levels[:, 60:100].mean() < 150


@pytest.mark.parametrize(
    ("square", "size", "expected"),
    [
        ((10, 20, 30, 40), (100, 50), (10, 20, 30, 40)),  # lies within
        ((-1, 23, 29, 53), (100, 50), (0, 21, 30, 51)),  # moved right, and up by 6% of its side
        ((-10, -30, 110, 90), (100, 50), (0, -20, 100, 80)),  # as large as the longer side
        ((0, 0, 1, 1), (1, 1), (0, 0, 1, 1)),
    ],
)
def test_square_before_any_background_moves_toward_the_photo(square: Box, size: tuple[int, int], expected: Box) -> None:
    assert _within(square, size) == expected


# --- a large object in front of any background: the whole photo as a second input ---------------------------


def _left(image: Image.Image, side: int) -> np.ndarray[tuple[int, int], np.dtype[np.uint8]]:
    """Take the left of a picture for the object, `side` pixels of it."""
    matte = np.zeros((image.height, image.width), np.uint8)
    matte[10:20, :side] = 255
    return matte


def test_preprocess_of_a_large_object_by_matting_adds_the_whole_photo() -> None:
    photo = image_file(_colors((64, 64)))
    framed = preprocess(photo, FRAMING, matting=_middle)
    assert framed.whole is not None
    np.testing.assert_array_equal(framed.whole, preprocess(photo, FRAMING, "keep").tensor)
    np.testing.assert_array_equal(framed.looks, np.concatenate([framed.tensor, framed.whole]))
    assert framed.weights == [1, 1]


def test_preprocess_of_a_growing_object_by_matting_lets_the_whole_photo_count_more_and_more() -> None:
    weights = []
    for side in range(100):
        framed = preprocess(image_file(_colors((100, 80))), FRAMING, matting=partial(_left, side=side + 1))
        weights.append(sum(framed.weights[1:]))
    assert weights[:60] == [0] * 60
    assert weights[69:] == [1] * 31
    np.testing.assert_allclose(np.diff(weights[59:70]), 0.1, atol=1e-9)


def test_preprocess_by_matting_shows_a_half_transparent_photo_whole_and_opaque() -> None:
    photo = _colors((64, 64))
    opaque = preprocess(image_file(photo), FRAMING, matting=_middle).whole
    photo.putalpha(100)
    half = preprocess(image_file(photo), FRAMING, matting=_middle).whole
    assert opaque is not None
    assert half is not None
    np.testing.assert_allclose(half, opaque, atol=1e-6)


def test_preprocess_of_a_wide_photo_adds_it_with_margins() -> None:
    wide = preprocess(
        image_file(_colors((64, 40))), FRAMING, matting=lambda image: np.full(image.size[::-1], 255, "u1")
    )
    assert wide.whole is not None
    is_margin = (wide.whole[0] == 1).all(axis=(0, 2))
    np.testing.assert_array_equal(np.flatnonzero(~is_margin), np.arange(12, 52))


@pytest.mark.parametrize("background", ["auto", "keep"])
def test_preprocess_of_a_small_object_or_without_a_network_has_one_look(background: Background) -> None:
    cut_out = _colors((64, 64)).convert("RGBA")
    cut_out.putalpha(Image.fromarray(_middle(cut_out)))
    for photo, matting in ((_colors((64, 64)), partial(_left, side=38)), (cut_out, _middle), (_colors((64, 64)), None)):
        framed = preprocess(image_file(photo), FRAMING, background, matting=matting)
        assert framed.whole is None
        assert len(framed.looks) == 1
