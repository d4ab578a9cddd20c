"""The compiled loops over pixels against NumPy and Pillow, to the last bit."""

from typing import Any

import numpy as np
import pytest
from PIL import Image

from service.encoding import compiled
from service.encoding.compiled import Pixels
from service.encoding.framing import Framing, preprocess
from service.encoding.masks import matte_of
from service.encoding.pixels import over_white
from tests.support.photos import disc, image_file
from tests.support.systems.modules import replace_module

# Building takes a C compiler: where there was none, these tests are of the tier that needs programs.
needs_pixels = pytest.mark.unit if compiled.load() else pytest.mark.system

Bytes = np.ndarray[Any, np.dtype[np.uint8]]


def _built() -> Pixels:
    """Return the compiled functions. Fail without them."""
    pixels = compiled.load()
    assert pixels is not None, "the pixel loops are not built: run `pip install --no-deps -e .` with a C compiler"
    return pixels


def _noise(seed: int, width: int, height: int, bands: int) -> Bytes:
    """Return levels of any value, many of them the smallest or the largest."""
    dice = np.random.default_rng(seed)
    return dice.integers(-100, 356, (height, width, bands)).clip(0, 255).astype(np.uint8)


def _speckled(seed: int, width: int, height: int) -> Image.Image:
    """Return a ground with slight noise and spots of any color: its border is uniform for some of the seeds."""
    dice = np.random.default_rng(seed)
    ground = dice.integers(0, 256, 3) + dice.integers(-13, 14, (height, width, 3)) * (
        dice.random((height, width, 1)) < 0.5
    )
    is_spot = dice.random((height, width, 1)) < 0.3 * dice.random()
    return Image.fromarray(
        np.where(is_spot, dice.integers(0, 256, (height, width, 3)), ground.clip(0, 255)).astype(np.uint8)
    )


@needs_pixels
@pytest.mark.parametrize("size", [(1, 1), (2, 1), (1, 3), (63, 64), (128, 65), (300, 17), (512, 512)])
def test_matte_of_a_border_has_the_bits_of_numpy(size: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    _built()
    images = [_speckled(seed, *size) for seed in range(20)]
    mattes = [matte_of(image, None)[1] for image in images]
    monkeypatch.setattr(compiled, "load", lambda: None)
    plain = [matte_of(image, None)[1] for image in images]
    assert [each is None for each in mattes] == [each is None for each in plain]
    assert any(each is not None for each in plain)
    for matte, expected in zip(mattes, plain, strict=True):
        np.testing.assert_array_equal(matte, expected)


@needs_pixels
@pytest.mark.parametrize("floor", [0, 8, 128, 255])
@pytest.mark.parametrize("size", [(1, 1), (33, 7), (1000, 3), (300, 400)])
def test_summary_of_a_matte_counts_and_adds(size: tuple[int, int], floor: int) -> None:
    matte = _noise(0, *size, 1)[:, :, 0]
    rows, columns = np.full(size[1], -1, np.int32), np.full(size[0], -1, np.int32)
    values = matte.astype(int)
    assert _built().summary(matte, floor, rows, columns) == (values.sum(), (values**2).sum())
    np.testing.assert_array_equal(rows, (matte > floor).sum(axis=1))
    np.testing.assert_array_equal(columns, (matte > floor).sum(axis=0))


@needs_pixels
@pytest.mark.parametrize("size", [1, 7, 160])
def test_square_has_the_bits_of_pillow(size: int) -> None:
    image, alpha = Image.fromarray(_noise(1, 400, 300, 3)), _noise(2, 400, 300, 1)[:, :, 0]
    dice = np.random.default_rng(size)
    for _ in range(100):
        side = int(dice.integers(size + 1, min(3 * size, compiled.MOST_SUMMED * size) + 2))
        left, top = (int(edge) for edge in dice.integers(-side - 10, (410, 310)))
        square = left, top, left + side, top + side
        part = image.crop(square)
        part.putalpha(Image.fromarray(alpha).crop(square))
        rgba = np.full((size, size, 4), 99, np.uint8)
        picture = compiled.picture_of(image)
        assert picture is not None
        _built().square(picture, alpha, left, top, side, rgba)
        np.testing.assert_array_equal(rgba, np.asarray(part.resize((size, size), Image.Resampling.BOX)), str(square))


@needs_pixels
@pytest.mark.parametrize("size", [1, 7, 32])
def test_square_around_transparent_pixels_has_the_bits_of_pillow(size: int) -> None:
    image, dice = Image.fromarray(_noise(1, 200, 150, 3)), np.random.default_rng(size)
    for _ in range(100):
        alpha = np.zeros((150, 200), np.uint8)
        top, left = (int(edge) for edge in dice.integers(0, 140, 2))
        height, width = (int(side) for side in dice.integers(1, 60, 2))
        alpha[top : top + height, left : left + width] = _noise(2, width, height, 1)[: 150 - top, : 200 - left, 0]
        alpha[::7] = 0
        side = int(dice.integers(size + 1, min(4 * size + 100, compiled.MOST_SUMMED * size)))
        x, y = (int(edge) for edge in dice.integers(-20, 100, 2))
        part = image.crop((x, y, x + side, y + side))
        part.putalpha(Image.fromarray(alpha).crop((x, y, x + side, y + side)))
        rgba, picture = np.full((size, size, 4), 99, np.uint8), compiled.picture_of(image)
        assert picture is not None
        _built().square(picture, alpha, x, y, side, rgba)
        np.testing.assert_array_equal(rgba, np.asarray(part.resize((size, size), Image.Resampling.BOX)))


@needs_pixels
@pytest.mark.parametrize("side", [1, 5, 64, 160])
def test_over_white_has_the_bits_of_numpy(side: int, monkeypatch: pytest.MonkeyPatch) -> None:
    _built()
    image = Image.fromarray(_noise(side, side, side, 4))
    tensor = over_white(image)
    monkeypatch.setattr(compiled, "load", lambda: None)
    plain = over_white(image)
    assert tensor.shape == plain.shape == (1, 3, side, side)
    assert tensor.tobytes() == plain.tobytes()


@needs_pixels
@pytest.mark.parametrize("size", [1, 4])
@pytest.mark.parametrize("less", [0, 1, 130])
def test_square_of_as_many_pixels_as_16_bits_can_sum_has_the_bits_of_pillow(size: int, less: int) -> None:
    side = compiled.MOST_SUMMED * size - less
    levels = np.full((side, side, 4), 255, np.uint8)
    levels[::50, ::3] = _noise(4, side, side, 4)[::50, ::3]
    image, alpha = Image.fromarray(levels).convert("RGB"), np.ascontiguousarray(levels[:, :, 3])
    rgba, picture = np.full((size, size, 4), 99, np.uint8), compiled.picture_of(image)
    assert picture is not None
    _built().square(picture, alpha, 0, 0, side, rgba)
    image.putalpha(Image.fromarray(alpha))
    np.testing.assert_array_equal(rgba, np.asarray(image.resize((size, size), Image.Resampling.BOX)))


@needs_pixels
@pytest.mark.parametrize("kind", ["border", "alpha", "large", "faint"])
@pytest.mark.parametrize("side", [64, 20])
def test_preprocess_gives_the_same_without_the_compiled_loops(
    kind: str, side: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    _built()
    image = disc(size=(300, 200))
    image = image.resize((2000, 1500)) if kind == "large" else image
    if kind in ("alpha", "faint"):
        alpha = _noise(3, *image.size, 1)[:, :, 0] // (10 if kind == "faint" else 1)
        alpha[:50] = 0
        image.putalpha(Image.fromarray(alpha))
    photo, framing = image_file(image), Framing(size=side)
    framed = preprocess(photo, framing, thumbnail=True)
    monkeypatch.setattr(compiled, "load", lambda: None)
    plain = preprocess(photo, framing, thumbnail=True)
    np.testing.assert_array_equal(framed.tensor, plain.tensor)
    assert framed.confidence == plain.confidence
    assert (framed.mask, framed.box, framed.thumbnail) == (plain.mask, plain.box, plain.thumbnail)


def test_picture_of_an_image_in_several_blocks_is_none() -> None:
    assert compiled.picture_of(Image.new("RGB", (3000, 3000))) is None


def _picture(width: int, height: int, mode: str = "RGB") -> Any:  # noqa: ANN401 - capsules
    return Image.new(mode, (width, height)).__arrow_c_array__()


MATTE = np.zeros((20, 30), np.uint8)


@needs_pixels
@pytest.mark.parametrize(
    ("function", "arguments", "message"),
    [
        ("border_matte", (_picture(30, 19), 1, 12, 16, 0.8, MATTE), "does not have 600 pixels of four bytes"),
        ("border_matte", (_picture(30, 20, "L"), 1, 12, 16, 0.8, MATTE), "does not have 600 pixels of four bytes"),
        ("border_matte", (_picture(30, 20)[::-1], 1, 12, 16, 0.8, MATTE), "PyCapsule_GetPointer"),
        ("border_matte", (_picture(30, 20), 0, 12, 16, 0.8, MATTE), "edge is 0"),
        ("border_matte", (_picture(30, 20), 21, 12, 16, 0.8, MATTE), "edge is 21"),
        ("border_matte", (_picture(30, 20), 1, 250, 16, 0.8, MATTE), "tolerance 250 and softness 16 make no ramp"),
        ("border_matte", (_picture(30, 20), 1, 2**31 - 1, 16, 0.8, MATTE), "tolerance 2147483647 and softness 16 make"),
        ("border_matte", (_picture(30, 20), 1, 12, 15, 0.8, MATTE), "tolerance 12 and softness 15 make no ramp"),
        ("border_matte", (_picture(30, 20), 1, 12, 16, 0.8, MATTE[0]), "matte has 1 dimensions"),
        ("summary", (MATTE, 8, np.zeros(20), np.zeros(30, np.int32)), "rows has 1 dimensions of format 'd'"),
        ("summary", (MATTE, 8, np.zeros(20, np.int32), np.zeros(20, np.int32)), "columns has length 20"),
        ("summary", (MATTE.T, 8, np.zeros(30, np.int32), np.zeros(20, np.int32)), "not a C-contiguous"),
        (
            "summary",
            (np.zeros((1, 65_536), np.uint8), 8, np.zeros(1, np.int32), np.zeros(65_536, np.int32)),
            "matte has 65536 columns",
        ),
        ("square", (_picture(30, 20), MATTE, 0, 0, 8, np.zeros((8, 8, 4), np.uint8)), "side is 8; more than 8 to 2056"),
        ("square", (_picture(30, 20), MATTE, 0, 0, 2057, np.zeros((8, 8, 4), np.uint8)), "side is 2057"),
        ("square", (_picture(30, 20), MATTE, 2**40, 0, 9, np.zeros((8, 8, 4), np.uint8)), "more than 16777216 pixels"),
        ("square", (_picture(30, 20), MATTE, 0, 0, 9, np.zeros((8, 7, 4), np.uint8)), "rgba has length 7"),
        ("over_white", (np.zeros((8, 8, 3), np.uint8), np.zeros((3, 8, 8), np.float32)), "rgba has length 3"),
        ("over_white", (np.zeros((8, 8, 4), np.uint8), np.zeros((3, 8, 7), np.float32)), "planes has length 7"),
        ("square", (_picture(29, 20), MATTE, 0, 0, 9, np.zeros((8, 8, 4), np.uint8)), "does not have 600 pixels"),
    ],
)
def test_wrong_arguments_raise_value_error(function: str, arguments: tuple[Any, ...], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        getattr(_built(), function)(*arguments)


@pytest.mark.parametrize("version", [None, compiled.VERSION - 1, compiled.VERSION + 1])
def test_load_of_another_version_gives_none(version: int | None, monkeypatch: pytest.MonkeyPatch) -> None:
    replace_module(monkeypatch, compiled.NAME, version)
    assert compiled.load.__wrapped__() is None
