"""Photos of 20 MB that repeat a small part: a real process answers soon, and within little memory."""

import struct
import threading
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from pathlib import Path

import httpx
import pytest

from service.encoding.containers import jpeg
from service.encoding.containers.container import Container
from service.encoding.decode import DEFAULT_MAX_PIXELS, decode_with_size
from service.settings import MIB
from tests.support.photos import disc, image_file, png_chunk
from tests.support.processes import Served, hof_serve
from tests.support.resources import cpu_s, reset_peak, status_bytes

SIZE = 20_000_000
MOST_S = 3  # of processor; the faults took 14 to more than 100
MOST_BYTES = 150 * MIB  # the body, its parts, and the file without its metadata
PHOTOS = {kind: image_file(disc(), kind) for kind in ("PNG", "JPEG")}


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory, model_path: Path) -> Iterator[Served]:
    with hof_serve(tmp_path_factory.mktemp("parts"), model_path) as served:
        httpx.post(f"{served.url}/encode", content=image_file(disc())).raise_for_status()
        yield served


def _png(kind: bytes, data: bytes) -> bytes:
    """Return a PNG that repeats a chunk after its header."""
    file, chunk = PHOTOS["PNG"], png_chunk(kind, data)
    return file[:33] + chunk * (SIZE // len(chunk)) + file[33:]


def _jpeg(marker: int, content: bytes, count: int = SIZE) -> bytes:
    """Return a JPEG that repeats a segment after its first marker."""
    file, segment = PHOTOS["JPEG"], struct.pack(">BBH", 0xFF, marker, len(content) + 2) + content
    return file[:2] + segment * min(count, SIZE // len(segment)) + file[2:]


def _box(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data) + 8) + kind + data


def _avif(extra: bytes, inside: bytes = b"") -> bytes:
    """Return an AVIF with one more box in `meta`, or in a box there; nothing that its offsets name moves."""
    file = image_file(disc(), "AVIF", speed=10)
    at = file.index(b"meta")
    end = at - 4 + int.from_bytes(file[at - 4 : at], "big")
    meta = file[at + 4 : end]
    if inside:
        start = meta.index(inside) - 4
        size = int.from_bytes(meta[start : start + 4], "big")
        meta = meta[:start] + _box(inside, meta[start + 8 : start + size] + extra) + meta[start + size :]
    else:
        meta += extra
    return file[:at] + b"free" + file[at + 4 :] + _box(b"meta", meta)


def _references() -> bytes:
    """Return references to as many items as there is room for; libavif looks each up among all others."""
    return b"\1\0\0\0" + b"".join(_box(b"cdsc", struct.pack(">IHI", number, 1, 1)) for number in range(100, SIZE // 18))


def _associations() -> bytes:
    """Return the properties of as many items as there is room for."""
    count = SIZE // 5
    return (
        b"\1\0\0\0"
        + struct.pack(">I", count)
        + b"".join(struct.pack(">IB", number + 100, 0) for number in range(count))
    )


def _frame() -> bytes:
    """Return a JPEG's frame of as many components as it can have."""
    return struct.pack(">BHHB", 8, 16, 16, 255) + b"".join(bytes([number, 0x11, 0]) for number in range(255))


EXIF_TEXT = b"Raw profile type exif\0\0"
FILES: dict[str, tuple[Callable[[], bytes], int]] = {
    "PNG profiles": (lambda: _png(b"iCCP", b"name\0\0" + zlib.compress(bytes(4 * MIB))), 201),
    "PNG XMP": (lambda: _png(b"iTXt", b"XML:com.adobe.xmp\0\1\0\0\0" + zlib.compress(bytes(MIB))), 201),
    "PNG packed XMP": (lambda: _png(b"zTXt", b"XML:com.adobe.xmp\0\0" + zlib.compress(bytes(MIB))), 201),
    "PNG EXIF as text": (lambda: _png(b"zTXt", EXIF_TEXT + zlib.compress(bytes(MIB))), 201),
    "PNG EXIF": (lambda: _png(b"eXIf", b"II*\0\x08\0\0\0\xff\xff" + bytes(1_000)), 201),
    "PNG palettes": (lambda: _png(b"PLTE", bytes(768)), 201),
    "JPEG EXIF": (lambda: _jpeg(0xE1, b"Exif\0\0" + bytes(292), 65_400), 201),
    "JPEG profiles": (lambda: _jpeg(0xE2, b"ICC_PROFILE\0\1\1" + bytes(292), 65_400), 201),
    "JPEG frames": (lambda: _jpeg(0xC0, _frame()), 400),
    "JPEG quantization": (lambda: _jpeg(0xDB, b"\0" + bytes([1]) * 64, 65_400), 201),
    "AVIF references": (lambda: _avif(_box(b"iref", _references())), 413),
    "AVIF properties": (lambda: _avif(_box(b"ipma", _associations()), b"iprp"), 413),
}


@pytest.mark.parametrize("name", FILES)
def test_photo_that_repeats_a_part_costs_little(served: Served, name: str) -> None:
    (draw, status), pid = FILES[name], served.process.pid
    data = draw()
    resident, before = status_bytes(pid, "VmRSS"), cpu_s(pid)
    reset_peak(pid)
    answer = httpx.post(f"{served.url}/encode", content=data, timeout=120)
    seconds, taken = cpu_s(pid) - before, status_bytes(pid, "VmHWM") - resident
    assert answer.status_code == status, answer.text
    assert seconds < MOST_S
    assert taken < MOST_BYTES


def test_decode_stopped_while_the_container_is_read_decodes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    stop, read = threading.Event(), jpeg.read

    def read_and_stop(data: bytes) -> Container:
        stop.set()
        return read(data)

    monkeypatch.setattr(jpeg, "read", read_and_stop)
    monkeypatch.setattr("service.encoding.decode._pixels", None)  # would fail
    with pytest.raises(CancelledError):
        decode_with_size(PHOTOS["JPEG"], DEFAULT_MAX_PIXELS, stop)
