"""AVIF, and HEIC by the extra `heic`."""

import io
import sys

import numpy as np
import pytest
from PIL import Image, features

from service.encoding.containers.boxes import brands, items
from service.encoding.decode import decode
from service.errors import CorruptImage, TooLarge, UnsupportedMedia
from tests.support.photos import disc, image_file

PHOTO = disc("blue", (64, 48), (4, 4))
HEIC_HEADER = b"\0\0\0\x1cftypheic\0\0\0\0mif1heicmiaf"


def _avif(image: Image.Image = PHOTO, **options: object) -> bytes:
    return image_file(image, "AVIF", speed=10, quality=95, **options)


def _heic(image: Image.Image = PHOTO, **options: object) -> bytes:
    pillow_heif = pytest.importorskip("pillow_heif")
    buffer = io.BytesIO()
    pillow_heif.from_pillow(image).save(buffer, quality=95, **options)
    return buffer.getvalue()


def test_decode_of_avif_gives_rgb() -> None:
    image = decode(_avif())
    assert (image.mode, image.size) == ("RGB", (64, 48))
    assert np.abs(np.asarray(image, int) - np.asarray(PHOTO, int)).mean() < 3


def test_decode_of_avif_keeps_transparency() -> None:
    photo = PHOTO.convert("RGBA")
    photo.putalpha(PHOTO.convert("L").point(lambda level: 255 if level < 128 else 0))
    image = decode(_avif(photo))
    assert image.mode == "RGBA"
    assert [image.getchannel("A").point(lambda level: level > 127).getpixel(at) for at in ((24, 24), (63, 47))] == [
        1,
        0,
    ]


@pytest.mark.parametrize("orientation", range(1, 9))
def test_decode_of_avif_turns_the_image_upright(orientation: int) -> None:
    exif = Image.Exif()
    exif[0x0112] = orientation
    plain = decode(image_file(PHOTO, exif=exif))
    upright = decode(_avif(exif=exif))  # Pillow takes the orientation out of `exif`
    assert np.abs(np.asarray(upright, int) - np.asarray(plain, int)).mean() < 3


@pytest.mark.parametrize("damage", [b"XX", b"II*\0\xff\xff\xff\xff", b""])
def test_decode_of_avif_with_damaged_exif_reads_it(damage: bytes) -> None:
    exif = Image.Exif()
    exif[0x010F] = "A maker whose name is long enough"
    sound = exif.tobytes()[6:]
    data = _avif(exif=exif)
    assert sound in data
    damaged = data.replace(sound, damage.ljust(len(sound), b"\xfe"))
    np.testing.assert_array_equal(decode(damaged), decode(data))


def test_decode_of_an_avif_sequence_gives_its_first_frame() -> None:
    frames = [Image.new("RGB", (64, 64), color) for color in ("red", "blue")]
    image = decode(_avif(frames[0], save_all=True, append_images=frames[1:]))
    assert np.abs(np.asarray(image, int) - (255, 0, 0)).max() < 20


def test_decode_of_truncated_avif_raises_corrupt_image() -> None:
    data = _avif(Image.effect_noise((200, 200), 90).convert("RGB"))
    for share in (0.01, 0.1, 0.5, 0.9):
        with pytest.raises((CorruptImage, UnsupportedMedia)):
            decode(data[: int(share * len(data))])


def test_decode_of_damaged_avif_raises_corrupt_image_or_reads_it() -> None:
    dice, data = np.random.default_rng(0), _avif()
    for _ in range(500):
        damaged = bytearray(data)
        for at in dice.integers(12, len(data), dice.integers(1, 6)):
            damaged[at] = dice.integers(256)
        try:
            decode(bytes(damaged), max_pixels=100_000)
        except (CorruptImage, TooLarge):
            continue


def test_decode_of_avif_without_its_decoder_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(features, "check", lambda _: False)
    with pytest.raises(UnsupportedMedia, match="AVIF is not supported here: it needs Pillow"):
        decode(_avif())


def test_decode_of_heic_without_the_extra_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pillow_heif.as_plugin", None)
    with pytest.raises(UnsupportedMedia, match=r"extra `heic`.*pip install '\.\[heic\]'"):
        decode(HEIC_HEADER + bytes(99))


def test_decode_of_heic_gives_rgb() -> None:
    image = decode(_heic())
    assert (image.mode, image.size) == ("RGB", (64, 48))
    assert np.abs(np.asarray(image, int) - np.asarray(PHOTO, int)).mean() < 3


def test_decode_of_heic_with_exif_turns_it_once() -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    assert decode(_heic(exif=exif.tobytes())).size == (48, 64)


def test_decode_of_truncated_heic_raises_corrupt_image() -> None:
    data = _heic()
    for share in (0.1, 0.5, 0.9):
        with pytest.raises((CorruptImage, UnsupportedMedia)):
            decode(data[: int(share * len(data))])


def test_decode_of_heic_beyond_the_limit_raises_too_large() -> None:
    with pytest.raises(TooLarge, match="64 x 48"):
        decode(_heic(), max_pixels=3_000)


def test_brands_of_other_files_are_none() -> None:
    assert brands(image_file(PHOTO)) == brands(b"") == frozenset()
    assert {b"heic", b"mif1"} <= brands(HEIC_HEADER)


def test_items_of_an_avif_are_its_picture_and_exif() -> None:
    exif = Image.Exif()
    exif[0x010F] = "maker"
    assert {b"av01", b"Exif"} <= {item.kind for item in items(_avif(exif=exif))}
