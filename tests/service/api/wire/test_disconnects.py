"""A client that leaves frees its work, and what waits for it never runs."""

import asyncio
import socket
import threading
import time
from contextlib import suppress
from pathlib import Path

import httpx

from service.settings import Settings
from tests.support.server import running
from tests.support.slow import DEADLINE_S, PATH, plain, runtime_of, until

WAITING, LEAVING = 7, 4


def _post(port: int, photo: bytes) -> socket.socket:
    connection = socket.create_connection(("127.0.0.1", port), timeout=DEADLINE_S)
    connection.sendall(f"POST {PATH} HTTP/1.1\r\nHost: x\r\nContent-Length: {len(photo)}\r\n\r\n".encode() + photo)
    return connection


def test_encode_of_clients_that_left_the_queue_never_runs(settings: Settings, slow_model: Path) -> None:
    with running(settings.model_copy(update={"model": (slow_model,), "threads": 1})) as server:
        runtime = runtime_of(server)
        (batcher,) = runtime.batchers.values()
        first = _post(server.port, plain(0))
        until(lambda: batcher.calls == 1)  # it has the only worker thread
        connections = [_post(server.port, plain(255, 255 - index)) for index in range(WAITING)]
        until(lambda: runtime.gates.images.held == 1 + WAITING)
        for connection in connections[:LEAVING]:
            connection.close()
        until(lambda: runtime.gates.images.cancelled == LEAVING)
        for connection in (first, *connections[LEAVING:]):
            assert connection.recv(65_536).startswith(b"HTTP/1.1 201 ")
            connection.close()
        assert batcher.images == 1 + WAITING - LEAVING
        assert runtime.gates.images.held == 0


def test_encode_of_a_client_that_left_releases_room_and_stores_nothing(
    settings: Settings,
    slow_model: Path,
) -> None:
    with running(settings.model_copy(update={"model": (slow_model,), "max_queued_images": 1})) as server:
        runtime = runtime_of(server)
        (batcher,) = runtime.batchers.values()
        connection = _post(server.port, plain(0))
        until(lambda: batcher.calls == 1)
        connection.close()
        until(lambda: runtime.gates.images.held == 0)
        with _post(server.port, plain(255, 255)) as other:
            assert other.recv(65_536).startswith(b"HTTP/1.1 201 ")
        assert (runtime.gates.images.cancelled, runtime.gates.images.finished) == (1, 1)
        with socket.create_connection(("127.0.0.1", server.port), timeout=DEADLINE_S) as lister:
            lister.sendall(b"GET /objects HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")
            received = b""
            while piece := lister.recv(65_536):
                received += piece
        assert received.count(b'"kind"') == 1


def test_runtime_run_when_canceled_stays_counted_until_its_thread_ends(settings: Settings) -> None:
    began, may_end = threading.Event(), threading.Event()
    ran: list[str] = []

    def long(name: str) -> None:
        ran.append(name)
        began.set()
        may_end.wait(DEADLINE_S)

    with running(settings.model_copy(update={"threads": 1})) as server:
        runtime = runtime_of(server)
        gate = runtime.gates.points

        async def held(name: str) -> None:
            with gate.admit(5):
                await runtime.run(long, name)

        async def leave() -> list[int]:
            one, queued = (asyncio.create_task(held(name)) for name in ("one", "queued"))
            await asyncio.to_thread(began.wait, DEADLINE_S)
            one.cancel()
            queued.cancel()
            await asyncio.wait((one, queued), timeout=0.1)
            counted = [gate.held]
            may_end.set()
            await asyncio.wait((one, queued))
            return [*counted, gate.held]

        assert asyncio.run(leave()) == [5, 0]
        assert ran == ["one"]


def test_upload_that_stalls_answers_408_and_releases_room(settings: Settings) -> None:
    with running(settings.model_copy(update={"client_timeout_s": 0.2})) as server:
        with socket.create_connection(("127.0.0.1", server.port), timeout=DEADLINE_S) as connection:
            connection.sendall(b"POST /encode HTTP/1.1\r\nHost: x\r\nContent-Length: 1000\r\n\r\nabc")
            answer = connection.recv(65_536)
        assert answer.startswith(b"HTTP/1.1 408 ")
        assert b"connection: close" in answer.lower()
        gates = runtime_of(server).gates
        assert (gates.images.held, gates.uploads.held) == (0, 0)


def test_upload_that_drips_answers_408_and_releases_room(settings: Settings) -> None:
    with running(settings.model_copy(update={"client_timeout_s": 0.5})) as server:
        gate = runtime_of(server).gates.images
        with socket.create_connection(("127.0.0.1", server.port), timeout=DEADLINE_S) as connection:
            connection.sendall(b"POST /encode HTTP/1.1\r\nHost: x\r\nContent-Length: 100000\r\n\r\na")
            until(lambda: gate.held == 1)
            deadline = time.monotonic() + DEADLINE_S
            while gate.held and time.monotonic() < deadline:
                with suppress(ConnectionError):
                    connection.sendall(b"a")
                time.sleep(0.05)
            answer = connection.recv(65_536)
        assert answer.startswith(b"HTTP/1.1 408 ")
        assert b"fewer than 8192 a second" in answer


def test_stream_that_nobody_reads_ends_and_releases_room(settings: Settings, photo: bytes) -> None:
    with running(settings.model_copy(update={"client_timeout_s": 0.2})) as server:
        gate = runtime_of(server).gates.points
        with httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=DEADLINE_S) as client:
            path = client.post("/encode", content=photo).json()["links"]["points"]
            with socket.create_connection(("127.0.0.1", server.port), timeout=DEADLINE_S) as connection:
                connection.sendall(f"GET {path}?n=10000000 HTTP/1.1\r\nHost: x\r\n\r\n".encode())
                until(lambda: gate.cancelled == 1)
                assert gate.held == 0
            assert client.get(path).status_code == 200
