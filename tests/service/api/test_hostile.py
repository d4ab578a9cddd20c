"""Requests that mean harm, over a raw socket or at a real process. Each is refused in a sentence and costs little.

Others are tested beside what they attack, in the folders of the same name as the code's: damaged and lying images in
encoding/, request heads, bodies without an end and stalled clients in server/ and api/, weights files in formats/.
"""

import io
import json
import os
import struct
import zipfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from urllib.parse import quote

import httpx
import pytest
from PIL import Image

from service.api.middleware.observe import MAX_PATH
from tests.support.photos import disc, image_file
from tests.support.processes import hof_serve
from tests.support.raw_sockets import connect, rest
from tests.support.resources import reset_peak, status_bytes
from tests.support.server import Server, check_refused
from tests.support.slow import until

MIB = 2**20
SIDE = 8_000  # 64 megapixels: twice the limit
JPEG_SIDE = 16_384  # 268 megapixels: a JPEG, which is decoded at a part of its size, may have 8 times the limit


def shortly(value: object) -> str:
    """Return the name of a test's parameter."""
    return ascii(value)[:40]


# --- images ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def real(model_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, int]]:
    """Run the service in a process of its own; its address and its pid."""
    with hof_serve(tmp_path_factory.mktemp("real"), model_path) as (url, process):
        httpx.post(f"{url}/encode", content=image_file(disc())).raise_for_status()
        yield url, process.pid


@pytest.fixture(scope="module")
def bombs() -> dict[str, bytes]:
    """Images of more pixels than their type may have, in small files; of the JPEGs only the headers have them."""
    white = Image.new("L", (SIDE, SIDE), 255)
    colored = white.convert("RGB")
    files = {
        "PNG": image_file(white, "PNG"),
        "WEBP": image_file(colored, "WEBP", method=0),
        "JPEG": _claiming(image_file(white, "JPEG"), JPEG_SIDE),
        "JPEG progressive": _claiming(image_file(white, "JPEG", progressive=True), JPEG_SIDE),
        "PNG animated": image_file(white, "PNG", save_all=True, append_images=[white]),
    }
    assert max(map(len, files.values())) < MIB
    return files


def _claiming(jpeg: bytes, side: int) -> bytes:
    """Return a JPEG of SIDE x SIDE pixels with a header that says `side` x `side`."""
    size, claim = struct.pack(">HH", SIDE, SIDE), struct.pack(">HH", side, side)
    assert jpeg.count(size) == 1
    return jpeg.replace(size, claim)


@pytest.mark.parametrize("kind", ["PNG", "WEBP", "JPEG", "JPEG progressive", "PNG animated"])
def test_encode_of_a_pixel_bomb_is_refused_without_memory(
    real: tuple[str, int], bombs: dict[str, bytes], kind: str
) -> None:
    url, pid = real
    before = status_bytes(pid, "VmRSS")
    reset_peak(pid)
    answer = httpx.post(f"{url}/encode", content=bombs[kind], timeout=60)
    assert (answer.status_code, answer.json()["title"]) == (413, "Too large")
    side = JPEG_SIDE if kind.startswith("JPEG") else SIDE
    assert f"{side} x {side}" in answer.json()["detail"]
    assert "32000000" in answer.json()["detail"]
    assert status_bytes(pid, "VmHWM") - before < 10 * MIB


def _archive(content: bytes) -> bytes:
    """Return a ZIP file that begins as the content does."""
    buffer = io.BytesIO(content)
    with zipfile.ZipFile(buffer, "a") as archive:
        archive.writestr("x.html", "<script>alert(1)</script>")
    return buffer.getvalue()


PAGE = b"<html><script>alert(1)</script></html>"
PHOTOS = {kind: image_file(disc(), kind) for kind in ("PNG", "JPEG", "WEBP", "GIF")}


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
@pytest.mark.parametrize(
    "behind", [PAGE, b"%PDF-1.7\n", b"PK\x05\x06" + bytes(18), PHOTOS["GIF"], b"\x7fELF" + bytes(99)]
)
def test_encode_of_an_image_with_a_second_type_reads_the_image_only(
    client: httpx.Client, kind: str, behind: bytes
) -> None:
    answer = client.post("/encode?include=weights", content=PHOTOS[kind] + behind)
    plain = client.post("/encode?include=weights", content=PHOTOS[kind])
    assert (answer.status_code, plain.status_code) == (201, 201)
    assert answer.json()["weights"] == plain.json()["weights"]
    assert b"script" not in answer.content


@pytest.mark.parametrize("before", [PAGE, b"%PDF-1.7\n", PHOTOS["GIF"], b"GIF89a", b"\n", b"\xef\xbb\xbf"])
def test_encode_of_an_image_after_other_bytes_is_refused(client: httpx.Client, before: bytes) -> None:
    for kind in ("PNG", "JPEG", "WEBP"):
        answer = client.post("/encode", content=before + PHOTOS[kind])
        assert (answer.status_code, answer.headers["content-type"]) == (415, "application/problem+json")


def test_encode_of_an_image_before_an_archive_ignores_the_archive(client: httpx.Client) -> None:
    assert client.post("/encode", content=_archive(PHOTOS["PNG"])).status_code == 201
    assert client.post("/objects", content=_archive(b"")).status_code == 400


# --- forms and bodies -----------------------------------------------------------------------------

FORM = {"Content-Type": "multipart/form-data; boundary=xyz"}


def _form(disposition: bytes, *fields: bytes) -> bytes:
    head = b"\r\n".join([b"--xyz", b"Content-Disposition: form-data; " + disposition, *fields])
    return head + b"\r\n\r\n" + PHOTOS["PNG"] + b"\r\n--xyz--\r\n"


@pytest.mark.parametrize(
    "body",
    [
        _form(b'name="image"', b"X-Long: " + bytes(199_000).replace(b"\0", b"a")),
        _form(b'name="image"', *[b"X-%d: a" % number for number in range(10_000)]),
        _form(b'name="' + bytes(100_000).replace(b"\0", b"a") + b'"'),
        _form(b'name="image"' + b'; name="image"' * 5_000),
        _form(b'name="image"; filename="' + bytes(100_000).replace(b"\0", b"\\") + b'"'),
        b"--xyz\r\n" * 20_000,
        b"--xyz\r\nContent-Disposition: form-data" + bytes(100_000).replace(b"\0", b";"),
    ],
    ids=["one field", "many fields", "name", "options", "escapes", "boundaries", "no end"],
)
def test_form_with_giant_headers_is_refused_or_they_are_ignored(client: httpx.Client, body: bytes) -> None:
    answer = client.post("/encode", content=body, headers=FORM)
    assert answer.status_code in (201, 400, 413, 422)
    assert len(answer.content) < 2_000


@pytest.mark.parametrize("boundary", ["", "a" * 60_000, '"', "\\", "*=utf-8''%00", "xyz; boundary=abc"], ids=shortly)
def test_form_with_an_odd_boundary_is_malformed(client: httpx.Client, boundary: str) -> None:
    headers = {"Content-Type": f"multipart/form-data; boundary={boundary}"}
    answer = client.post("/encode", content=_form(b'name="image"'), headers=headers)
    assert (answer.status_code, answer.headers["content-type"]) == (400, "application/problem+json")


@pytest.mark.parametrize(
    "name", ["../../etc/passwd", "a\r\nSet-Cookie: x=y", "\0.png", "%0d%0aX-A: b", "\U0001f4a3" * 50]
)
def test_form_file_name_is_ignored(client: httpx.Client, name: str) -> None:
    answer = client.post("/encode", files={"image": (name, PHOTOS["PNG"], "image/png")})
    assert answer.status_code == 201
    assert not {"set-cookie", "x-a"} & set(answer.headers)
    points = client.get(answer.json()["links"]["points"], params={"n": 1})
    assert points.headers["content-disposition"] == f'attachment; filename="hof-{answer.json()["id"]}.ply"'


DEEP = [b"[" * 16_000, b'{"objects":' * 1_400, b'{"objects":[' + b"[" * 8_000 + b"]" * 8_000 + b"]}"]


@pytest.mark.parametrize("body", DEEP, ids=["lists", "objects", "closed"])
@pytest.mark.parametrize("path", ["/compose", "/v2/models/tiny-k2/infer", "/objects"])
def test_json_body_nested_too_deeply_is_refused(client: httpx.Client, path: str, body: bytes) -> None:
    if path == "/objects":  # the header of a weights file
        body = len(body).to_bytes(8, "little") + body
    answer = client.post(path, content=body)
    assert answer.status_code in (400, 422)
    assert answer.headers["content-type"] == "application/problem+json"
    assert len(answer.content) < 2_000


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_number_that_is_not_finite_is_refused(client: httpx.Client, number: str) -> None:
    shape = [1, 3, 32, 32]
    body = json.dumps({"inputs": [{"name": "image", "datatype": "FP32", "shape": shape, "data": [0.5] * 3_072}]})
    tensor = client.post("/v2/models/tiny-k2/infer", content=body.replace("0.5", number, 1))
    assert tensor.status_code in (400, 422)
    for member in ("objects", "mode"):
        assert client.post("/compose", content=f'{{"{member}": {number}}}').status_code in (400, 422)
    item = client.post("/encode", content=PHOTOS["PNG"]).json()
    for path, field in (("points", "scale"), ("points", "n"), ("mesh", "scale"), ("mesh", "resolution")):
        check_refused(client.get(f"{item['links'][path]}?{field}={quote(number)}"), field, "")
    check_refused(client.post(f"/encode?foreground_ratio={number}", content=PHOTOS["PNG"]), "foreground_ratio", "")


@pytest.mark.parametrize(
    "n", ["9" * 5_000, "1e3", "0x10", "1_000", "\u0661\u0660", "-0", " 1", "1.0", "+1"], ids=shortly
)
def test_integer_parameter_in_odd_notation_is_refused_or_exact(client: httpx.Client, n: str) -> None:
    item = client.post("/encode", content=PHOTOS["PNG"]).json()
    answer = client.get(item["links"]["points"], params={"n": n, "format": "f32"})
    assert answer.status_code == 422 or len(answer.content) == 12 * int(n.partition(".")[0])


# --- paths and headers ----------------------------------------------------------------------------

ID = "0" * 32


@pytest.mark.parametrize(
    "path",
    [
        "/objects/../../../etc/passwd",
        "/objects/..%2f..%2f..%2fetc%2fpasswd",
        "/objects/%2e%2e/%2e%2e/points",
        f"/objects/{ID}%00/points",
        f"/objects/{ID}%0d%0aX-A:%20b",
        f"/objects/{ID}'%20OR%20'1'='1",
        f"/objects/{ID.upper().replace('0', 'A')}",
        "/objects/" + "%ff" * 32,
        "/objects/" + "%f0%9f%92%a3" * 8,
        "/objects/" + "\uff10" * 32,
        "/objects/" + "a" * 30_000,
        "/viewer/../../settings.py",
        "/viewer/..%2f..%2fsettings.py",
        "/viewer/%2e%2e/%2e%2e/app.py",
        "/viewer//etc/passwd",
        "/viewer/%2fetc%2fpasswd",
        "/viewer/viewer.js%00.html",
        "/viewer/..%5c..%5csettings.py",
        "/v2/models/..%2f..%2fetc/ready",
        "//objects",
        "/./objects/../metrics/..",
    ],
    ids=shortly,
)
def test_path_with_tricks_reads_no_file(server: Server, path: str) -> None:
    with connect(server) as connection:
        target = path if path.isascii() else quote(path)
        connection.sendall(f"GET {target} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n".encode())
        head, _, body = rest(connection).partition(b"\r\n\r\n")
    assert head.startswith((b"HTTP/1.1 404 ", b"HTTP/1.1 400 ")), head
    assert b"application/problem+json" in head
    assert b"x-a:" not in head.lower()
    assert b"root:" not in body
    assert len(body) < 1_000


def test_long_path_is_logged_truncated(real: tuple[str, int], tmp_path_factory: pytest.TempPathFactory) -> None:
    url, pid = real
    assert httpx.get(f"{url}/{'a' * 30_000}").status_code == 404
    log = Path(os.readlink(f"/proc/{pid}/fd/2"))
    until(lambda: "a" * (MAX_PATH - 1) in log.read_text())  # a line follows its answer
    assert "a" * MAX_PATH not in log.read_text()


@pytest.mark.parametrize(
    "name", ["X-Request-ID", "Accept", "If-None-Match", "Accept-Encoding", "Range", "Host", "Origin"]
)
def test_client_header_cannot_inject_an_answer_header(server: Server, name: str) -> None:
    for value in (b"a\rX-A: b", b"a\nX-A: b", b"a\0b", b"\xff\xfe", b"a, " * 5_000, b"*/*;q=" + b"9" * 5_000, b""):
        with connect(server) as connection, suppress(ConnectionError):
            connection.sendall(b"GET /model HTTP/1.1\r\nHost: x\r\nConnection: close\r\n")
            connection.sendall(name.encode() + b": " + value + b"\r\n\r\n")
            head = rest(connection).partition(b"\r\n\r\n")[0]
            assert head.split(b" ")[1] in (b"200", b"400", b"406"), (value, head)
            assert b"x-a:" not in head.lower()


@pytest.mark.parametrize(
    "head",
    [
        b"Content-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\nGET /metrics HTTP/1.1\r\nHost: x\r\n\r\n",
        b"Content-Length: 5\r\nContent-Length: 6\r\n\r\nabcdef",
        b"Content-Length: -1\r\n\r\n",
        b"Content-Length: +5\r\n\r\nabcde",
        b"Content-Length: 99999999999999999999999999\r\n\r\n",
        b"Content-Length: 0x5\r\n\r\nabcde",
        b"Transfer-Encoding: chunked\r\n\r\n-1\r\nabc\r\n0\r\n\r\n",
        b"Transfer-Encoding: chunked\r\n\r\nfffffffffffffffff\r\nabc",
        b"Transfer-Encoding: chunked, identity\r\n\r\n0\r\n\r\n",
        b"Transfer-Encoding : chunked\r\n\r\n0\r\n\r\n",
        b" folded: yes\r\n\r\n",
    ],
    ids=shortly,
)
def test_body_with_two_lengths_or_none_is_refused_without_smuggling(server: Server, head: bytes) -> None:
    with connect(server) as connection:
        connection.sendall(b"POST /encode HTTP/1.1\r\nHost: x\r\nConnection: close\r\n" + head)
        answer = rest(connection)
    assert answer.startswith((b"HTTP/1.1 400 ", b"HTTP/1.1 413 ", b"HTTP/1.1 415 ")), answer
    assert answer.count(b"HTTP/1.1 ") == 1
