"""Request heads, sent byte for byte over a raw socket: limits of size and time."""

import contextlib
import json
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from service.api.middleware.security_headers import SECURE
from service.server.http_protocol import FREE_CHUNKS, MAX_HEAD_BYTES, PUNCTUATION
from service.settings import Settings
from tests.support.processes import hof_serve
from tests.support.raw_sockets import ask, connect, next_status, rest
from tests.support.resources import processor_ns
from tests.support.server import Server, running
from tests.support.slow import DEADLINE_S, runtime_of, until

LINE = b"GET /health/live HTTP/1.1\r\nHost: x\r\n"
FILLER = b"a: " + bytes(1_019).replace(b"\0", b"b") + b"\r\n"  # 1 KiB


@pytest.fixture
def impatient(settings: Settings) -> Iterator[Server]:
    """Run a server that waits half a second for its clients."""
    with running(settings.model_copy(update={"client_timeout_s": 0.5})) as server:
        yield server


def check_problem(answer: bytes, status: int, title: str) -> None:
    """Check that an answer is a complete problem document and ends the connection."""
    head, _, body = answer.partition(b"\r\n\r\n")
    first, *fields = head.decode().split("\r\n")
    headers = dict(field.split(": ") for field in fields)
    assert int(first.split()[1]) == status
    assert headers.items() >= {name.lower(): value for name, value in SECURE.items()}.items()
    assert (headers["content-type"], headers["connection"]) == ("application/problem+json", "close")
    assert int(headers["content-length"]) == len(body)
    problem = json.loads(body)
    assert (problem["status"], problem["title"]) == (status, title)


@pytest.mark.parametrize(
    "head",
    [
        LINE + 65 * FILLER + b"\r\n",
        b"GET /health/live?" + bytes(MAX_HEAD_BYTES).replace(b"\0", b"n") + b" HTTP/1.1\r\n\r\n",
        LINE + b"a:\r\n" * (MAX_HEAD_BYTES // 5 + 1),
    ],
    ids=["fields", "target", "empty fields"],
)
def test_head_over_the_limit_is_431(server: Server, head: bytes) -> None:
    with connect(server) as connection:
        connection.sendall(head)
        check_problem(rest(connection), 431, "Head too large")


@pytest.mark.parametrize("begin", [LINE + b"a: ", LINE, LINE.partition(b" HTTP")[0] + b"?", b""])
def test_head_without_an_end_is_cut_off(server: Server, begin: bytes) -> None:
    sent = 0
    with connect(server) as connection, contextlib.suppress(ConnectionError):  # the server hangs up
        connection.sendall(begin)
        while sent < 1_000 * MAX_HEAD_BYTES:
            sent += connection.send(bytes(10_000).replace(b"\0", b"a"))
    assert sent < 100 * MAX_HEAD_BYTES  # the limit, and what the sockets' buffers hold


def test_head_of_exactly_the_limit_is_answered(client: httpx.Client) -> None:
    fields = client.build_request("GET", "/health/live", headers={"a": ""}).headers.raw
    others = len("/health/live") + sum(len(name) + len(value) + PUNCTUATION for name, value in fields)
    for excess, status in ((0, 200), (1, 431)):
        headers = {"a": "b" * (MAX_HEAD_BYTES - others + excess)}
        assert client.get("/health/live", headers=headers).status_code == status


def test_head_of_each_request_of_a_connection_has_the_whole_limit(server: Server) -> None:
    with connect(server) as connection:
        for _ in range(3):
            connection.sendall(LINE + 60 * FILLER + b"\r\n")
            assert next_status(connection) == 200


def test_trailers_over_the_limit_are_431(server: Server) -> None:
    with connect(server) as connection:
        connection.sendall(b"POST /encode HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n" + 65 * FILLER)
        check_problem(rest(connection), 431, "Head too large")


def test_trailers_within_the_limit_are_dropped_and_are_no_framing(server: Server) -> None:
    with connect(server) as connection:
        head = b"POST /encode HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n"
        connection.sendall(head + b"5\r\nhello\r\n0\r\n" + 60 * FILLER + b"\r\n")
        assert next_status(connection) == 415


def test_body_with_chunk_extensions_costs_little_more_than_another_that_is_refused(
    model_path: Path, tmp_path: Path
) -> None:
    tiny = 2 * FREE_CHUNKS * b"1\r\na\r\n"
    bodies = [tiny, *(9 * (b"1" + extension + b"\r\na\r\n") for extension in (b";" + 16_000 * b"a", 8_000 * b";c"))]
    costs = []
    with hof_serve(tmp_path, model_path) as served:
        for body in bodies:
            request = b"POST /encode HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n" + body
            ask(served.url, request)
            before = processor_ns(served.process.pid)
            assert {ask(served.url, request).status for _ in range(30)} == {400}
            costs.append(processor_ns(served.process.pid) - before)
    assert max(costs) < 2 * costs[0]


@pytest.mark.parametrize("data", [b"", LINE, LINE + b"a: b", b"\r\n\r\n"])
def test_head_that_is_too_slow_ends_the_connection(impatient: Server, data: bytes) -> None:
    with connect(impatient) as connection:
        connection.sendall(data)
        answer = rest(connection)
    if data.strip():
        check_problem(answer, 408, "Stalled")
    else:
        assert answer == b""


def test_head_that_drips_gains_no_time(impatient: Server) -> None:
    deadline = time.monotonic() + DEADLINE_S
    with connect(impatient) as connection:
        connection.sendall(LINE)
        with contextlib.suppress(ConnectionError):  # the server hangs up
            while time.monotonic() < deadline:
                connection.sendall(b"a: b\r\n")
                time.sleep(0.05)
    assert time.monotonic() < deadline


@pytest.mark.parametrize("data", [b"\r\n", b"G", LINE])
def test_connection_after_an_answer_is_not_kept_open_by_a_few_bytes(impatient: Server, data: bytes) -> None:
    impatient.config.timeout_keep_alive = 1
    with connect(impatient) as connection:
        connection.sendall(LINE + b"\r\n")
        assert next_status(connection) == 200
        connection.sendall(data)
        answer = rest(connection)
    assert answer.startswith(b"HTTP/1.1 408 ") or not data.strip()


@pytest.mark.parametrize(
    "data", [b"\0\1\2\3\r\n\r\n", b"GET\r\n\r\n", b"GET / HTTP/1.1\r\na b\r\n\r\n", b"\x16\x03\x01"]
)
def test_bytes_that_are_not_http_are_400(server: Server, data: bytes) -> None:
    with connect(server) as connection:
        connection.sendall(data)
        check_problem(rest(connection), 400, "Invalid input")


def test_bytes_after_a_request_do_not_corrupt_its_answer(server: Server, client: httpx.Client) -> None:
    expected = client.get("/openapi.json").content
    with connect(server) as connection:
        connection.sendall(b"GET /openapi.json HTTP/1.1\r\nHost: x\r\n\r\n\0")
        answer = rest(connection)
    assert answer == b"" or answer.endswith(expected)


def test_pipelined_requests_are_dropped_with_the_connection(server: Server) -> None:
    with connect(server) as connection:
        connection.sendall(1_000 * (LINE + b"\r\n"))
        answer = rest(connection)
    assert answer.startswith(b"HTTP/1.1 200 ")
    assert answer.count(b"HTTP/1.1 ") == 1


def test_client_that_pipelines_and_leaves_is_noticed(server: Server, photo: bytes) -> None:
    gate = runtime_of(server).gates.points
    object_id = httpx.post(f"http://127.0.0.1:{server.port}/encode", content=photo, timeout=DEADLINE_S).json()["id"]
    with connect(server) as connection:
        first = f"GET /objects/{object_id}/points?n=10000000 HTTP/1.1\r\nHost: x\r\n\r\n".encode()
        connection.sendall(first + LINE + b"\r\n")
        until(lambda: gate.held > 0)
    until(lambda: gate.cancelled == 1)
    assert (gate.held, gate.finished) == (0, 0)


def test_hof_serve_limits_heads_and_logs_the_refusals(model_path: Path, tmp_path: Path) -> None:
    with hof_serve(tmp_path, model_path, "--client-timeout-s", "0.5") as (url, _):
        assert httpx.get(f"{url}/health/live", headers={"a": "b" * MAX_HEAD_BYTES}).status_code == 431
        with socket.create_connection(
            (httpx.URL(url).host, httpx.URL(url).port or 0), timeout=DEADLINE_S
        ) as connection:
            connection.sendall(LINE)
            check_problem(rest(connection), 408, "Stalled")
    entries = [json.loads(line) for line in (tmp_path / "log").read_text().splitlines() if "no request" in line]
    assert [(line["status"], line["client"]) for line in entries] == [(431, "127.0.0.1"), (408, "127.0.0.1")]
