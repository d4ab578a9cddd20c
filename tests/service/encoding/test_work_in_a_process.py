"""Photos at a real process: expensive ones are refused or stopped, odd ones are encoded."""

import io
import socket
import struct
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import numpy as np
import pytest
from PIL import Image, ImageCms, ImageDraw

from tests.support.photos import disc, image_file, many_scans, png_chunk, png_file, with_metadata
from tests.support.processes import hof_serve
from tests.support.resources import cpu_s
from tests.support.slow import until
from tests.support.systems import endless_jpeg

SHARE = 0.1  # of a decoding, after which the client leaves
WAIT_S = 120


@pytest.fixture(scope="module")
def slow_photo() -> bytes:
    """Draw a progressive JPEG at the pixel limit: the most work that one photo may be."""
    noise = Image.fromarray(np.random.default_rng(0).integers(0, 255, (500, 1000), np.uint8))
    return image_file(noise.resize((8_000, 4_000)).convert("CMYK"), "JPEG", progressive=True, quality=70)


def _send(url: str, photo: bytes) -> socket.socket:
    """Post a photo, and return the connection without reading the answer."""
    address = urlsplit(url)
    connection = socket.create_connection((address.hostname, address.port))
    head = f"POST /encode?background=keep HTTP/1.1\r\nHost: {address.netloc}\r\nContent-Length: {len(photo)}\r\n\r\n"
    connection.sendall(head.encode() + photo)
    return connection


def _await_cpu(pid: int, least_s: float) -> None:
    deadline = time.monotonic() + WAIT_S
    while cpu_s(pid) < least_s:
        assert time.monotonic() < deadline
        time.sleep(0.01)


def _decoded(client: httpx.Client, pid: int, photo: bytes) -> float:
    """Return the CPU time of decoding a photo, seconds."""
    before = cpu_s(pid)
    assert client.post("/encode?background=keep", content=photo).status_code == 201
    return cpu_s(pid) - before


def test_decoding_for_a_client_that_left_stops(tmp_path: Path, model_path: Path, slow_photo: bytes) -> None:
    small = image_file(disc())
    with hof_serve(tmp_path, model_path) as (url, process), httpx.Client(base_url=url, timeout=WAIT_S) as client:
        whole = _decoded(client, process.pid, slow_photo)
        before = cpu_s(process.pid)
        with _send(url, slow_photo + b"another id"):
            _await_cpu(process.pid, before + SHARE * whole)
        assert client.post("/encode", content=small).status_code == 201  # the only thread is free again
        assert cpu_s(process.pid) - before < whole / 2
        assert len(client.get("/objects").json()["items"]) == 2


def test_sigterm_while_a_photo_is_decoded_ends_the_process_without_a_fault(tmp_path: Path, model_path: Path) -> None:
    """The decoding never ends, so the process ends only if the decoding is stopped."""
    log = tmp_path / "log"
    with (
        hof_serve(tmp_path, model_path, "--shutdown-s=1", command=endless_jpeg.COMMAND) as (url, process),
        _send(url, image_file(disc(), "JPEG")),
    ):
        until(lambda: endless_jpeg.BEGUN in log.read_text())
        process.terminate()
        process.wait(WAIT_S)
    assert "Traceback" not in log.read_text()


def test_expensive_files_are_answered_413(tmp_path: Path, model_path: Path) -> None:
    webp = image_file(Image.new("RGB", (9_000, 4_000)), "WEBP", lossless=True, method=0)
    with hof_serve(tmp_path, model_path) as (url, process), httpx.Client(base_url=url, timeout=WAIT_S) as client:
        assert client.post("/encode", content=image_file(disc())).status_code == 201
        before = cpu_s(process.pid)
        for data in (many_scans(4_000), webp):
            answer = client.post("/encode", content=data)
            assert (answer.status_code, answer.json()["title"]) == (413, "Too large")
        assert cpu_s(process.pid) - before < 2  # the scans took 30 s


def _with_alpha(alpha: Image.Image) -> Image.Image:
    photo = disc()
    photo.putalpha(alpha)
    return photo


def _one_faint_pixel() -> Image.Image:
    alpha = Image.new("L", disc().size, 255)
    alpha.putpixel((3, 3), 254)
    return alpha


def _rounded_corners() -> Image.Image:
    alpha = Image.new("L", disc().size, 0)
    ImageDraw.Draw(alpha).rounded_rectangle((0, 0, 119, 89), 12, fill=255)
    return alpha


def _gray(depth: int) -> bytes:
    """Draw a black square on a transparent white: 120 x 90 pixels of a few bits."""
    per_byte = 8 // depth
    row, empty = b"\0" + b"\xff" * 5 + bytes(10) + b"\xff" * (120 // per_byte - 15), b"\0" + b"\xff" * (120 // per_byte)
    transparent = png_chunk(b"tRNS", struct.pack(">H", 2**depth - 1))
    return png_file(120, 90, depth, 0, empty * 20 + row * 40 + empty * 30, transparent)


EXIF = b"II*\0\x08\0\0\0\2\0\x12\1\3\0\1\0\0\0\6\0\0\0\x1a\1\2\0\3\0\0\0" + b"72\0\0" + bytes(4)
SRGB = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
ODD: dict[str, tuple[Callable[[], bytes], str, int, int]] = {  # file, mask, width, height
    "odd EXIF of a turned JPEG": (
        lambda: with_metadata(image_file(disc(), "JPEG"), b"\xe1Exif\0\0", EXIF),
        *("border", 90, 120),
    ),
    "odd EXIF of a turned PNG": (lambda: with_metadata(image_file(disc()), b"eXIf", EXIF), "border", 90, 120),
    "odd EXIF of a turned WebP": (lambda: with_metadata(image_file(disc(), "WEBP"), b"EXIF", EXIF), "border", 90, 120),
    "no EXIF": (lambda: with_metadata(image_file(disc()), b"eXIf", b"no TIFF header"), "border", 120, 90),
    "large text": (
        lambda: with_metadata(image_file(disc()), b"zTXt", b"Comment\0\0" + zlib.compress(bytes(9_000_000))),
        *("border", 120, 90),
    ),
    "broken segment": (
        lambda: with_metadata(image_file(disc(), "JPEG"), b"\xe2MPF\0", b"MM\0*\xff\xff\xff\xff"),
        *("border", 120, 90),
    ),
    "broken profile": (lambda: with_metadata(image_file(disc(), "WEBP"), b"ICCP", b"no profile"), "border", 120, 90),
    "profile": (lambda: image_file(disc(), icc_profile=SRGB), "border", 120, 90),
    "one faint pixel": (lambda: image_file(_with_alpha(_one_faint_pixel())), "border", 120, 90),
    "rounded corners": (lambda: image_file(_with_alpha(_rounded_corners())), "border", 120, 90),
    "gray of 2 bits": (lambda: _gray(2), "alpha", 120, 90),
    "gray of 4 bits": (lambda: _gray(4), "alpha", 120, 90),
    "JPEG without its end": (lambda: image_file(disc(), "JPEG")[:-2], "border", 120, 90),
    "48 megapixels": (
        lambda: image_file(disc("navy", (640, 480), (200, 150)).resize((8_000, 6_000)), "JPEG"),
        *("border", 8_000, 6_000),
    ),
    "AVIF": (lambda: image_file(disc(), "AVIF", speed=10), "border", 120, 90),
    "HEIC": (lambda: _heic(disc()), "border", 120, 90),
}


def _heic(photo: Image.Image) -> bytes:
    buffer = io.BytesIO()
    pytest.importorskip("pillow_heif").from_pillow(photo).save(buffer, quality=95)
    return buffer.getvalue()


@pytest.fixture(scope="module")
def url_and_log(tmp_path_factory: pytest.TempPathFactory, model_path: Path) -> Iterator[tuple[str, Path]]:
    folder = tmp_path_factory.mktemp("odd")
    with hof_serve(folder, model_path) as (url, _):
        yield url, folder / "log"


@pytest.mark.parametrize("name", ODD)
def test_photos_with_odd_metadata_are_encoded(url_and_log: tuple[str, Path], name: str) -> None:
    (url, log), (draw, *expected) = url_and_log, ODD[name]
    answer = httpx.post(f"{url}/encode", content=draw(), timeout=WAIT_S)
    assert answer.status_code in (200, 201), answer.text  # two odd photos may be the same object
    image = answer.json()["image"]
    assert [image["mask"], image["width"], image["height"]] == expected
    assert "Warning: " not in log.read_text()
    assert "Traceback" not in log.read_text()
