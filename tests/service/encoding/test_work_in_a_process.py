"""Photos at a real process: expensive ones are refused or stopped, odd ones are encoded."""

import socket
import time
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import numpy as np
import pytest
from PIL import Image

from tests.support.photos import disc, image_file, many_scans, with_metadata
from tests.support.processes import hof_serve
from tests.support.resources import cpu_s

SHARE = 0.1  # of a decoding, after which the client leaves or the service stops
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


def test_sigterm_while_a_photo_is_decoded_ends_the_process_without_a_fault(
    tmp_path: Path, model_path: Path, slow_photo: bytes
) -> None:
    with hof_serve(tmp_path, model_path, "--shutdown-s=1") as (url, process):
        with httpx.Client(base_url=url, timeout=WAIT_S) as client:
            whole = _decoded(client, process.pid, slow_photo)
        before = cpu_s(process.pid)
        with _send(url, slow_photo + b"another id"):
            _await_cpu(process.pid, before + SHARE * whole)
            process.terminate()
            process.wait(WAIT_S)
    assert "Traceback" not in (tmp_path / "log").read_text()


def test_expensive_files_are_answered_413(tmp_path: Path, model_path: Path) -> None:
    webp = image_file(Image.new("RGB", (9_000, 4_000)), "WEBP", lossless=True, method=0)
    with hof_serve(tmp_path, model_path) as (url, process), httpx.Client(base_url=url, timeout=WAIT_S) as client:
        assert client.post("/encode", content=image_file(disc())).status_code == 201
        before = cpu_s(process.pid)
        for data in (many_scans(4_000), webp):
            answer = client.post("/encode", content=data)
            assert (answer.status_code, answer.json()["title"]) == (413, "Too large")
        assert cpu_s(process.pid) - before < 2  # the scans took 30 s


def test_photos_with_odd_metadata_are_encoded(tmp_path: Path, model_path: Path) -> None:
    exif = b"II*\0\x08\0\0\0\2\0\x12\1\3\0\1\0\0\0\6\0\0\0\x1a\1\2\0\3\0\0\0" + b"72\0\0" + bytes(4)
    files = [
        with_metadata(image_file(disc(), "JPEG"), b"\xe1Exif\0\0", exif),
        with_metadata(image_file(disc()), b"eXIf", b"no TIFF header"),
        image_file(disc(), "JPEG")[:-2],
        image_file(disc(), "AVIF", speed=10),
    ]
    with hof_serve(tmp_path, model_path) as (url, _), httpx.Client(base_url=url, timeout=WAIT_S) as client:
        images = [client.post("/encode", content=data).json()["image"] for data in files]
    assert [(image["mask"], image["width"], image["height"]) for image in images] == [
        ("border", 90, 120),
        ("border", 120, 90),
        ("border", 120, 90),
        ("border", 120, 90),
    ]
    assert "Warning: " not in (tmp_path / "log").read_text()
