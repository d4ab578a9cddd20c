"""Requests that no ordinary client sends, over a raw socket at `hof serve`: none is misread or smuggles another."""

import json
import socket
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from PIL import Image

from service.server.http_protocol import FREE_CHUNKS, MAX_FRAMING_BYTES, MIN_CHUNK_BYTES
from service.settings import MIB
from tests.support.photos import disc, image_file
from tests.support.processes import Served, hof_serve
from tests.support.raw_sockets import ask, connect_to, next_answer
from tests.support.slow import DEADLINE_S, PATH, until

PHOTO = image_file(disc())
CHUNKED = b"POST /encode HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n"
SECOND = b"GET /health/live HTTP/1.1\r\nHost: x\r\n\r\n"
UPGRADES = {
    "curl": b"Connection: Upgrade, HTTP2-Settings\r\nUpgrade: h2c\r\nHTTP2-Settings: AAMAAABkAAQAoAAAAAIAAAAA\r\n",
    "java": b"Connection: Upgrade, HTTP2-Settings\r\nHTTP2-Settings: AAEAAEAAAAIAAAAB\r\nUpgrade: h2c\r\n",
    "websocket": b"Connection: keep-alive, Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n",
    "two fields": b"Connection: keep-alive\r\nConnection: UPGRADE\r\nUpgrade: foo\r\nUpgrade: h2c\r\n",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("served")


@pytest.fixture(scope="module")
def served(folder: Path, model_path: Path) -> Iterator[Served]:
    with hof_serve(folder, model_path, "--log-format=json", "--workers=1") as served:
        yield served


@pytest.fixture(scope="module")
def link(served: Served) -> str:
    """Path of a stored object."""
    answer = httpx.post(f"{served.url}/encode", content=image_file(disc("blue")), timeout=DEADLINE_S)
    link: str = answer.json()["links"]["self"]
    return link


def logged(folder: Path) -> list[dict[str, object]]:
    """Return the entries of the access log."""
    lines = (folder / "log").read_text().rpartition("\n")[0].splitlines()
    return [entry for entry in map(json.loads, lines) if "route" in entry]


def send_without_end(connection: socket.socket) -> None:
    """Send until the server ends the connection. Raises ConnectionError then."""
    while True:
        connection.sendall(bytes(MIB))


def framed(body: bytes, framing: str) -> tuple[bytes, bytes]:
    """Return the field and the bytes of a body, in one length or in chunks."""
    if framing == "length":
        return b"Content-Length: %d\r\n" % len(body), body
    return b"Transfer-Encoding: chunked\r\n", b"%x\r\n%b\r\n0\r\n\r\n" % (len(body), body)


# --- another protocol -------------------------------------------------------------------------------


@pytest.mark.parametrize("framing", ["length", "chunks"])
@pytest.mark.parametrize("upgrade", UPGRADES.values(), ids=list(UPGRADES))
def test_upgrade_of_a_request_with_a_body_is_ignored(served: Served, upgrade: bytes, framing: str) -> None:
    field, body = framed(PHOTO, framing)
    head = b"POST /encode HTTP/1.1\r\nHost: x\r\n" + upgrade + field + b"\r\n"
    for parts in ([head + body], [head, body], [head[:60], head[60:-2], head[-2:] + body[:9], body[9:]]):
        assert ask(served.url, *parts).status in (200, 201)
    with connect_to(served.url) as connection:
        connection.sendall(head + body)
        assert next_answer(connection).status == 200
        connection.sendall(SECOND)
        assert next_answer(connection).status == 200


@pytest.mark.parametrize("framing", ["length", "chunks"])
@pytest.mark.parametrize("upgrade", UPGRADES.values(), ids=list(UPGRADES))
def test_request_in_the_body_of_an_upgrade_is_never_executed(
    served: Served, folder: Path, link: str, upgrade: bytes, framing: str
) -> None:
    field, body = framed(f"DELETE {link} HTTP/1.1\r\nHost: x\r\n\r\n".encode(), framing)
    head = b"POST /encode HTTP/1.1\r\nHost: x\r\n" + upgrade + field + b"\r\n"
    for parts in ([head + body], [head, body]):
        assert ask(served.url, *parts).status == 415
    assert httpx.get(served.url + link).status_code == 200
    assert [entry for entry in logged(folder) if entry["method"] == "DELETE"] == []


def test_upgrade_without_a_body_is_ignored(served: Served) -> None:
    for upgrade in UPGRADES.values():
        with connect_to(served.url) as connection:
            for _ in range(2):
                connection.sendall(b"GET /health/live HTTP/1.1\r\nHost: x\r\n" + upgrade + b"\r\n")
                assert next_answer(connection).status == 200


@pytest.mark.parametrize(
    ("head", "status"),
    [
        (b"GET /health/live HTTP/1.1\r\n", 400),
        (b"GET /health/live HTTP/1.1\r\nHost: x\r\nHost: x\r\n", 400),
        (b"GET /health/live HTTP/1.1\r\nHost: x\r\nHOST: y\r\n", 400),
        (b"GET /health/live HTTP/1.0\r\nHost: x\r\nHost: x\r\n", 400),
        (b"GET /health/live HTTP/1.1\r\nHost:\r\n", 400),
        (b"GET /health/live HTTP/1.1\r\nHost: a b\r\n", 400),
        (b"GET /health/live HTTP/1.1\r\nHost: user@x\r\n", 400),
        (b"GET /health/live HTTP/1.1\r\nHost: x/y\r\n", 400),
        (b"GET /health/live HTTP/1.1\r\nHost: x:y\r\n", 400),
        (b"GET http://a@b/health/live HTTP/1.1\r\nHost: x\r\n", 400),
        (b"CONNECT x:80 HTTP/1.1\r\nHost: x\r\n", 400),
        (b"POST /encode HTTP/1.0\r\nHost: x\r\nTransfer-Encoding: chunked\r\n", 400),
        (b"GET /health/live HTTP/2.0\r\nHost: x\r\n", 505),
        (b"GET /health/live HTTP/0.9\r\nHost: x\r\n", 505),
        (b"PRI * HTTP/2.0\r\n\r\nSM\r\n", 400),
        (b"GET /health/live HTTP/1.0\r\n", 200),
        (b"GET /health/live HTTP/1.1\r\nHost: x:8080\r\n", 200),
        (b"GET /health/live HTTP/1.1\r\nHost: [::1]:8080\r\n", 200),
        (b"GET http://x/health/live HTTP/1.1\r\nHost: y\r\n", 200),
    ],
)
def test_head_against_the_rules_is_refused(served: Served, head: bytes, status: int) -> None:
    answer = ask(served.url, head + b"\r\n")
    assert answer.status == status
    assert status == 200 or answer.headers["content-type"] == "application/problem+json"


def test_answer_to_http_1_0_comes_without_chunks(served: Served, link: str) -> None:
    head = f"GET {link}/points?n=1000&format=json HTTP/1.%d\r\nHost: x\r\nAccept-Encoding: %b\r\n\r\n".encode()
    for coding in (b"identity", b"gzip"):
        old, new = (ask(served.url, head % (minor, coding)) for minor in (0, 1))
        assert "transfer-encoding" not in old.headers
        assert old.headers["connection"] == "close"
        assert new.headers["transfer-encoding"] == "chunked"
        assert (old.status, old.body) == (200, new.body)
    assert ask(served.url, head.replace(b"GET", b"HEAD") % (0, b"identity")).status == 200


def test_fields_that_come_in_several_lines_are_joined(served: Served, link: str) -> None:
    def head(*fields: str) -> bytes:
        lines = "".join(f"{field}\r\n" for field in fields)
        return f"GET {link}/points?n=10 HTTP/1.1\r\nHost: x\r\n{lines}\r\n".encode()

    answer = ask(served.url, head("Accept: text/html", "Accept: application/json"))
    assert (answer.status, answer.headers["content-type"]) == (200, "application/json")
    tag = ask(served.url, head()).headers["etag"]
    assert ask(served.url, head('If-None-Match: "x"', f"If-None-Match: {tag}")).status == 304
    assert ask(served.url, head('If-None-Match: "x"', 'If-None-Match: "y"')).status == 200


# --- framing --------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [1, MIN_CHUNK_BYTES // 2])
def test_body_in_tiny_chunks_is_cut_off(served: Served, size: int) -> None:
    answer = ask(served.url, CHUNKED + 10 * FREE_CHUNKS * (b"%x\r\n" % size + size * b"a" + b"\r\n"))
    assert (answer.status, answer.headers["connection"]) == (400, "close")
    assert b"on average" in answer.body


@pytest.mark.parametrize("extension", [b";a=" + 1_000 * b"b", 200 * b";c"])
def test_body_with_extensions_without_end_is_cut_off(served: Served, extension: bytes) -> None:
    chunk = b"%x%b\r\n%b\r\n" % (MIN_CHUNK_BYTES, extension, MIN_CHUNK_BYTES * b"a")
    answer = ask(served.url, CHUNKED, 4 * MAX_FRAMING_BYTES // len(extension) * chunk)
    assert (answer.status, answer.headers["connection"]) == (400, "close")
    assert b"framing" in answer.body


def test_body_in_ordinary_chunks_is_taken(served: Served) -> None:
    photo = image_file(Image.effect_noise((400, 400), 50).convert("RGB"))
    head = CHUNKED.replace(b"/encode", PATH.encode())
    for size in (MIN_CHUNK_BYTES + 1, 4_096, 65_536):
        parts = (photo[i : i + size] for i in range(0, len(photo), size))
        body = b"".join(b"%x;sig=abc\r\n%b\r\n" % (len(part), part) for part in parts)
        assert ask(served.url, head + body + b"0\r\n\r\n").status in (200, 201)
    few, rest = photo[: FREE_CHUNKS // 2], photo[FREE_CHUNKS // 2 :]
    tiny = b"".join(b"1\r\n%c\r\n" % byte for byte in few)
    assert ask(served.url, head + tiny + b"%x\r\n%b\r\n0\r\n\r\n" % (len(rest), rest)).status == 200


@pytest.mark.parametrize("sent", [0, 9], ids=["no byte", "some bytes"])
@pytest.mark.parametrize("field", [b"Content-Length: 10000", b"Transfer-Encoding: chunked"])
@pytest.mark.parametrize("path", ["/encode", "/objects", "/compose", "/v2/models/tiny-k2/infer"])
def test_upload_that_its_client_aborts_is_logged_499(
    served: Served, folder: Path, path: str, field: bytes, sent: int
) -> None:
    begin = len(logged(folder))
    with connect_to(served.url) as connection:
        connection.sendall(
            f"POST {path} HTTP/1.1\r\nHost: x\r\n".encode() + field + b"\r\n\r\n" + b"5\r\nhello\r\n"[:sent]
        )
        until(lambda: "hof_http_requests_in_flight 2.0" in httpx.get(f"{served.url}/metrics").text)
    until(lambda: any(entry["status"] == 499 for entry in logged(folder)[begin:]))


def test_body_with_a_framing_fault_is_logged_400(served: Served, folder: Path) -> None:
    begin = len(logged(folder))
    assert ask(served.url, CHUNKED, b"nonsense\r\n").status == 400
    until(lambda: len(logged(folder)) > begin)
    assert [entry["status"] for entry in logged(folder)[begin:]] == [400]


# --- bodies that are not read ---------------------------------------------------------------------


@pytest.mark.parametrize("path", ["/encode", "/objects"])
def test_client_that_reads_after_it_has_sent_gets_the_refusal_of_its_body(served: Served, path: str) -> None:
    body = bytes(40 * MIB)
    with connect_to(served.url) as connection:
        connection.sendall(f"POST {path} HTTP/1.1\r\nHost: x\r\nContent-Length: {len(body)}\r\n\r\n".encode())
        connection.sendall(body)
        answer = next_answer(connection)
    assert (answer.status, answer.headers["connection"]) == (413, "close")


def test_client_that_sends_on_after_a_refusal_is_cut_off(served: Served) -> None:
    with connect_to(served.url) as connection:
        connection.sendall(b"POST /encode HTTP/1.1\r\nHost: x\r\nContent-Length: 1000000000000\r\n\r\n")
        assert next_answer(connection).status == 413
        with pytest.raises(ConnectionError):
            send_without_end(connection)
