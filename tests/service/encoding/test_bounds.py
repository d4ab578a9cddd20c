"""Work for decoding: bounded before it begins, and stopped when nobody waits for it."""

import struct
import threading
from concurrent.futures import CancelledError

import numpy as np
import pytest
from PIL import Image, ImageFile
from PIL.WebPImagePlugin import WebPImageFile

from service.encoding import decode as decoding
from service.encoding.containers import avif, jpeg
from service.encoding.decode import DEFAULT_MAX_PIXELS, decode, decode_with_size
from service.encoding.framing import Framing, preprocess
from service.errors import CorruptImage, TooLarge
from tests.support.photos import disc, image_file, many_scans, png_file


def _without_decoder(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make every decoding of pixels fail."""
    monkeypatch.setattr(ImageFile.ImageFile, "load", None)
    monkeypatch.setattr(WebPImageFile, "load", None)
    monkeypatch.setattr(decoding, "_frame", None)


# --- scans, chunks, frames, pixels ----------------------------------------------------------------


@pytest.mark.parametrize("count", [jpeg.MAX_SCANS, 4_000])
def test_decode_of_a_jpeg_with_many_scans_raises_too_large(count: int, monkeypatch: pytest.MonkeyPatch) -> None:
    _without_decoder(monkeypatch)
    with pytest.raises(TooLarge, match=f"more than {jpeg.MAX_SCANS} scans"):
        decode(many_scans(count))


def test_decode_of_a_jpeg_with_scans_for_too_many_samples_raises_too_large(monkeypatch: pytest.MonkeyPatch) -> None:
    _without_decoder(monkeypatch)
    with pytest.raises(TooLarge, match="scans visit"):
        decode(many_scans(100), max_pixels=512 * 512)


@pytest.mark.parametrize("mode", ["L", "RGB", "CMYK"])
@pytest.mark.parametrize("subsampling", [0, 2])
def test_decode_of_a_progressive_jpeg_at_the_limit_is_allowed(mode: str, subsampling: int) -> None:
    photo = disc("blue", (512, 512)).convert(mode)
    data = image_file(photo, "JPEG", progressive=True, subsampling=subsampling)
    assert decode(data, max_pixels=512 * 512).size == (512, 512)


def test_decode_of_an_animated_webp_decodes_only_its_first_frame() -> None:
    frames = [Image.new("RGB", (64, 64), color) for color in ("red", "lime", "blue")]
    data = image_file(frames[0], "WEBP", save_all=True, append_images=frames[1:], lossless=True)
    cut = data[: data.rindex(b"ANMF") + 40]  # the last frame is damaged
    np.testing.assert_array_equal(decode(cut[:4] + struct.pack("<I", len(cut) - 8) + cut[8:]), frames[0])


def test_decode_of_an_animated_png_decodes_only_its_first_frame() -> None:
    frames = [Image.new("RGB", (64, 64), color) for color in ("red", "lime", "blue")]
    data = image_file(frames[0], save_all=True, append_images=frames[1:])
    np.testing.assert_array_equal(decode(data[: data.index(b"fdAT") + 8] + bytes(200)), frames[0])


def test_decode_of_a_webp_beyond_the_limit_allocates_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(WebPImageFile, "_open", None)  # would fail: it allocates two canvases
    with pytest.raises(TooLarge, match=r"8000 x 4000 pixels, the limit is 1000000 .*HOF_MAX_IMAGE_PIXELS"):
        decode(image_file(Image.new("RGB", (8_000, 4_000)), "WEBP", lossless=True, method=0), max_pixels=1_000_000)


# --- photos of phones -----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def phone_photo() -> Image.Image:
    """Draw 48 megapixels."""
    return disc("navy", (640, 480), (200, 150)).resize((8_000, 6_000))


@pytest.mark.parametrize("options", [{}, {"progressive": True}], ids=["baseline", "progressive"])
def test_preprocess_of_a_jpeg_of_48_megapixels_reads_it_at_a_part_of_its_size(
    phone_photo: Image.Image, options: dict[str, object]
) -> None:
    framed = preprocess(image_file(phone_photo, "JPEG", **options), Framing())
    assert (framed.mask, framed.width, framed.height) == ("border", 8_000, 6_000)
    np.testing.assert_allclose(framed.box, (2_500, 1_875, 3_012, 2_388), atol=16)


def test_decode_of_a_png_of_48_megapixels_names_the_setting() -> None:
    with pytest.raises(TooLarge, match=r"8000 x 6000 pixels.*HOF_MAX_IMAGE_PIXELS, --max-image-pixels"):
        decode(png_file(8_000, 6_000, 8, 2, b""))


def test_decode_of_a_jpeg_beyond_8_times_the_limit_raises_too_large() -> None:
    data = image_file(disc(), "JPEG")  # 120 x 90
    assert decode(data, max_pixels=1_350).size == (30, 23)
    with pytest.raises(TooLarge):
        decode(data, max_pixels=1_349)


# --- the end of a JPEG ----------------------------------------------------------------------------


@pytest.mark.parametrize("mode", ["L", "RGB", "CMYK"])
@pytest.mark.parametrize("options", [{}, {"progressive": True}, {"restart_marker_blocks": 4}], ids=str)
def test_decode_of_a_jpeg_without_its_end_marker_gives_the_same_pixels(mode: str, options: dict[str, object]) -> None:
    noise = Image.fromarray(np.random.default_rng(0).integers(0, 255, (100, 120, 3), np.uint8)).convert(mode)
    data = image_file(noise, "JPEG", **options)
    for end in (b"", b"\xff", b"\xff\xff", b"\0\0\0"):
        np.testing.assert_array_equal(decode(data[:-2] + end), decode(data))


@pytest.mark.parametrize("options", [{}, {"progressive": True}], ids=str)
@pytest.mark.parametrize("lost", [3, 10, 100, 1_000])
def test_decode_of_a_jpeg_that_lacks_data_raises_corrupt_image(options: dict[str, object], lost: int) -> None:
    noise = Image.fromarray(np.random.default_rng(0).integers(0, 255, (96, 128, 3), np.uint8))
    with pytest.raises(CorruptImage):
        decode(image_file(noise, "JPEG", **options)[: -2 - lost])


def test_decode_of_a_progressive_jpeg_that_lacks_whole_scans_raises_corrupt_image() -> None:
    data = image_file(disc(), "JPEG", progressive=True)
    starts = [at for at in range(len(data)) if data[at : at + 2] == b"\xff\xda"]
    assert len(starts) > 5
    for start in starts:
        with pytest.raises(CorruptImage):
            decode(data[:start])


def test_decode_beyond_the_memory_that_the_limit_stands_for_raises_too_large() -> None:
    data = image_file(Image.new("RGBA", (64, 64), (9, 9, 9, 9)), "AVIF", speed=10, subsampling="4:4:4")
    assert decode(data, max_pixels=5_000).size == (64, 64)
    with pytest.raises(TooLarge, match="decoding the image takes 57344 bytes, the limit is 49152, 12 for each pixel"):
        decode(data, max_pixels=64 * 64)


# --- AVIF -----------------------------------------------------------------------------------------


def test_decode_of_an_avif_whose_boxes_announce_a_smaller_picture_raises_too_large(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    _without_decoder(monkeypatch)
    data = image_file(Image.new("RGB", (2_000, 1_500)), "AVIF", speed=10)
    at = data.index(b"ispe") + 8
    with pytest.raises(TooLarge, match="2000 x 1500 pixels"):
        decode(data[:at] + struct.pack(">II", 64, 64) + data[at + 8 :], max_pixels=1_000_000)


@pytest.mark.parametrize("subsampling", ["4:0:0", "4:2:0", "4:2:2", "4:4:4"])
@pytest.mark.parametrize("mode", ["RGB", "RGBA"])
@pytest.mark.parametrize("size", [(1, 1), (63, 65), (64, 64), (257, 1_000)])
def test_sequence_headers_of_avif_give_the_size(subsampling: str, mode: str, size: tuple[int, int]) -> None:
    container = avif.read(image_file(Image.new(mode, size), "AVIF", speed=10, subsampling=subsampling))
    assert container.size == size
    samples = {"4:0:0": 1, "4:2:0": 1.5, "4:2:2": 3, "4:4:4": 3}[subsampling] + (mode == "RGBA")
    assert abs(container.buffered_bytes - 1.5 * samples * size[0] * size[1]) <= 4


# --- the end of work ------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["PNG", "JPEG"])
def test_decode_stops_soon_after_the_event(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    noise = Image.fromarray(np.random.default_rng(0).integers(0, 255, (800, 800, 3), np.uint8))
    data, stop, sizes = image_file(noise, kind), threading.Event(), list[int]()

    class Source(decoding._Source):
        def read(self, size: int | None = -1) -> bytes:
            sizes.append(size or 0)
            if sum(sizes[-3:]) >= 3 * decoding.BLOCK_BYTES:
                stop.set()
            return super().read(size)

    monkeypatch.setattr(decoding, "_Source", Source)
    with pytest.raises(CancelledError):
        decode_with_size(data, DEFAULT_MAX_PIXELS, stop)
    assert sum(sizes) < len(data) / 2


def test_preprocess_after_the_event_does_nothing() -> None:
    stop = threading.Event()
    stop.set()
    with pytest.raises(CancelledError):
        preprocess(image_file(disc(), "WEBP"), Framing(), stop=stop)
