"""Overload: work over the limits answers 429 with Retry-After, and probes go on answering."""

import socket
import sqlite3
import struct
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path

import httpx
import pytest

from service.formats.weights import Weights, dump
from service.mapping.spec import HOF_1, initial_theta
from service.runtime import liveness
from service.runtime.cost import in_flight
from service.settings import Settings
from service.storage import sqlite
from service.storage.sqlite import SQLITE_CONNECTIONS, SqliteDatabase
from tests.service.mapping.engines import needs_kernel
from tests.support.processes import hof, serving
from tests.support.resources import others, threads
from tests.support.server import Server, check_refused, running
from tests.support.slow import DEADLINE_S, PATH, plain, runtime_of, until
from tests.support.small.model import SPEC

BIG = "n=10000000&format=f32"


@pytest.fixture
def slow(settings: Settings, slow_model: Path) -> Iterator[Server]:
    """Run a server of two worker threads that admits three images and one large stream, with the slow model."""
    limits = {"model": (slow_model,), "max_queued_images": 3, "max_points_in_flight": 1}
    with running(settings.model_copy(update=limits)) as server:
        yield server


@pytest.fixture
def quick(slow: Server) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=f"http://127.0.0.1:{slow.port}", timeout=DEADLINE_S) as client:
        yield client


def test_encode_over_the_image_limit_answers_429_until_room_is_released(slow: Server, quick: httpx.Client) -> None:
    gate = runtime_of(slow).gates.images
    with ThreadPoolExecutor(3) as pool:
        taken = [pool.submit(quick.post, PATH, content=plain(red)) for red in range(3)]
        until(lambda: gate.held == 3)
        refused = quick.post(PATH, content=plain(255, 255))
        problem = refused.json()
        assert (refused.status_code, problem["title"], problem["status"]) == (429, "Overloaded", 429)
        assert refused.headers["content-type"] == "application/problem+json"
        assert 1 <= int(refused.headers["retry-after"]) <= 60
        assert "3 images" in problem["detail"]
        assert [future.result().status_code for future in taken] == [201] * 3
    assert quick.post(PATH, content=plain(255, 255)).status_code == 201
    assert (gate.held, gate.finished, gate.refused, gate.failed, gate.cancelled) == (0, 4, 1, 0, 0)


@pytest.mark.parametrize("path", [PATH, "/v2/models/tiny-k2/infer"])
def test_images_with_a_full_gate_are_refused_before_the_body_is_read(
    slow: Server, quick: httpx.Client, path: str
) -> None:
    with ThreadPoolExecutor(3) as pool:
        taken = [pool.submit(quick.post, PATH, content=plain(red)) for red in range(3)]
        until(lambda: runtime_of(slow).gates.images.held == 3)
        with socket.create_connection(("127.0.0.1", slow.port), timeout=DEADLINE_S) as connection:
            head = f"POST {path} HTTP/1.1\r\nHost: x\r\nContent-Length: 99999\r\nExpect: 100-continue\r\n\r\n"
            connection.sendall(head.encode())
            assert connection.recv(65_536).startswith(b"HTTP/1.1 429 ")
        for future in taken:
            future.result()


@pytest.mark.parametrize("path", ["/objects", "/compose"])
def test_point_work_with_a_full_gate_is_refused_before_the_body_is_read(
    slow: Server, quick: httpx.Client, path: str
) -> None:
    points = quick.post(PATH, content=plain(255, 255)).json()["links"]["points"]
    gate = runtime_of(slow).gates.points
    address = ("127.0.0.1", slow.port)
    with (
        socket.create_connection(address, timeout=DEADLINE_S) as stream,
        socket.create_connection(address, timeout=DEADLINE_S) as connection,
    ):
        stream.sendall(f"GET {points}?{BIG} HTTP/1.1\r\nHost: x\r\n\r\n".encode())
        until(lambda: gate.held > 0)
        head = f"POST {path} HTTP/1.1\r\nHost: x\r\nContent-Length: 999\r\nExpect: 100-continue\r\n\r\n"
        connection.sendall(head.encode())
        assert connection.recv(65_536).startswith(b"HTTP/1.1 429 ")
    assert gate.refused == 1


def test_probes_with_every_worker_busy_answer_200(slow: Server, quick: httpx.Client) -> None:
    answered = 0
    with ThreadPoolExecutor(3) as pool:
        for first in range(0, 12, 3):  # more photos on a machine too busy for 20 probes in the time of three
            taken = [pool.submit(quick.post, PATH, content=plain(first + red)) for red in range(3)]
            until(lambda: runtime_of(slow).gates.images.held == 3)
            while answered < 20 and not any(future.done() for future in taken):
                assert quick.get("/health/live").status_code == 200
                assert quick.get("/health/ready").status_code == 200
                answered += 1
            for future in taken:
                future.result()
            if answered == 20:
                break
    assert answered == 20  # probes that waited for a worker would be two or so for each three photos


def test_ready_with_a_hanging_encoder_answers_503_until_it_recovers(
    slow: Server, quick: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, seconds in {"FRESH_S": 0.0, "PROBE_TIMEOUT_S": 0.05, "MAX_SILENCE_S": 0.2}.items():
        monkeypatch.setattr(liveness, name, seconds)
    with ThreadPoolExecutor(1) as pool:
        hanging = pool.submit(quick.post, PATH, content=plain(0))
        until(lambda: quick.get("/health/ready").status_code == 503)
        assert quick.get("/health/ready").json()["detail"] == "the model tiny-k2 does not answer"
        assert quick.get("/health/live").status_code == 200
        assert not hanging.done()
        hanging.result()
    until(lambda: quick.get("/health/ready").status_code == 200)


def test_encode_with_one_failing_image_in_a_batch_fails_that_image_only(slow: Server, quick: httpx.Client) -> None:
    colors = [(0, 0, 255)] + [(255, 255, 0 if index % 2 else 200) for index in range(1, 3)]
    with ThreadPoolExecutor(3) as pool:
        answers = list(pool.map(lambda color: quick.post(PATH, content=plain(*color)).status_code, colors))
    assert answers == [201, 500, 201]
    gate = runtime_of(slow).gates.images
    assert (gate.held, gate.finished, gate.failed) == (0, 2, 1)


def test_points_over_the_limit_answer_429_until_the_stream_ends(slow: Server, quick: httpx.Client) -> None:
    path = quick.post(PATH, content=plain(255, 255)).json()["links"]["points"]
    gate = runtime_of(slow).gates.points
    with socket.create_connection(("127.0.0.1", slow.port), timeout=DEADLINE_S) as connection:
        connection.sendall(f"GET {path}?{BIG} HTTP/1.1\r\nHost: x\r\n\r\n".encode())
        until(lambda: gate.held > 0)
        refused = quick.get(path)
        assert (refused.status_code, refused.json()["title"]) == (429, "Overloaded")
        assert "content-disposition" not in refused.headers
        assert quick.get(path.replace("points", "weights")).status_code == 429
        assert quick.head(path).status_code == 200  # costs nothing
    until(lambda: gate.held == 0)
    assert (gate.cancelled, gate.refused) == (1, 2)
    assert len(quick.get(f"{path}?n=100&format=f32").content) == 1200


@needs_kernel  # NumPy has prices of its own
@pytest.mark.parametrize(("limit", "status"), [(1_000_000, 429), (30_000_000, 200)])
def test_points_of_a_large_function_cost_more_and_are_limited_lower(
    settings: Settings, limit: int, status: int
) -> None:
    wide = replace(HOF_1, hidden=(3_500,), k=16)  # 19 times the work of the default model
    file = dump(Weights(wide, 0.1 * initial_theta(wide), "m"), "safetensors")
    with (
        running(settings.model_copy(update={"max_points_in_flight": limit})) as server,
        httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=DEADLINE_S) as client,
    ):
        gate = runtime_of(server).gates.points
        path = client.post("/objects", content=file).json()["links"]["points"]
        small = client.post(PATH, content=plain(255)).json()["links"]["points"]
        with socket.create_connection(("127.0.0.1", server.port), timeout=DEADLINE_S) as connection:
            connection.sendall(f"GET {path}?n=7000000 HTTP/1.1\r\nHost: x\r\n\r\n".encode())
            assert connection.recv(65_536).startswith(b"HTTP/1.1 200 ")  # alone, whatever it takes
            assert gate.held == min(19 * in_flight(7_000_000, settings.threads), limit * 3 // 4)
            assert client.get(f"{small}?n=1").status_code == status  # a client leaves room for others
            with httpx.Client(transport=httpx.HTTPTransport(local_address="127.0.0.2")) as other:
                assert other.get(f"{client.base_url}{small}?n=1").status_code == 200
        until(lambda: gate.held == 0)
        assert client.head(f"{small}?n=8421053").status_code == 200
        check_refused(client.get(f"{path}?n=8421053"), "n", "8421052")


@needs_kernel  # NumPy has prices of its own
def test_mesh_and_compose_of_a_huge_function_are_refused_over_the_limit(settings: Settings) -> None:
    huge = replace(HOF_1, hidden=(28_571,), k=8)  # 73 times the work of the default model
    files = [dump(Weights(huge, 0.001 * initial_theta(huge, seed), "m"), "safetensors") for seed in range(2)]
    limits = {"max_weights_bytes": 1_000_000, "max_points": 300_000}
    with (
        running(settings.model_copy(update=limits)) as server,
        httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=DEADLINE_S) as client,
    ):
        one, other = (client.post("/objects", content=file).json() for file in files)
        path = one["links"]["mesh"]
        check_refused(client.get(f"{path}?resolution=60"), "resolution", "65753")
        assert client.get(f"{path}?resolution=8").status_code == 200
        body = {"objects": [one["id"], other["id"]], "mode": "all"}
        check_refused(client.post("/compose", json=body), "objects", "65753")
        word = {"objects": [one["id"]] * 4 + [other["id"]] * 4}
        assert client.post("/compose", json=word).status_code == 201


def test_store_locked_by_another_process_answers_writes_with_429_until_released(
    settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sqlite, "BUSY_TIMEOUT_MS", 2_000)
    files = [dump(Weights(SPEC, initial_theta(SPEC, seed), "m"), "safetensors") for seed in range(SQLITE_CONNECTIONS)]
    with (
        running(settings) as server,
        httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=DEADLINE_S) as client,
        closing(sqlite3.connect(tmp_path / "store" / "hof.db", isolation_level=None)) as other,
        ThreadPoolExecutor(len(files)) as pool,
    ):
        assert client.get("/objects").json()["items"] == []
        other.execute("BEGIN IMMEDIATE")  # no other writer comes in
        writes = [pool.submit(client.post, "/objects", content=file) for file in files]
        database = runtime_of(server).store._database
        assert isinstance(database, SqliteDatabase)
        until(lambda: database._writes._is_writing)
        assert client.get("/objects").status_code == 200  # reads don't wait for a writer
        for answer in (write.result() for write in writes):
            assert (answer.status_code, answer.json()["title"]) == (429, "Overloaded")
            assert int(answer.headers["retry-after"]) >= 1
        other.execute("ROLLBACK")
        assert [client.post("/objects", content=file).status_code for file in files] == [201] * len(files)


@pytest.mark.filterwarnings("ignore")  # connections that are reset, in the server's thread
def test_uploads_over_the_byte_limit_are_refused_until_bytes_are_released(settings: Settings) -> None:
    with running(settings.model_copy(update={"max_upload_bytes": 400_000})) as server, ExitStack() as stack:
        gates = runtime_of(server).gates
        url = f"http://127.0.0.1:{server.port}{PATH}"
        for field, held in ((b"Content-Length: 130000", 120_000), (b"Transfer-Encoding: chunked", 240_000)):
            connection = stack.enter_context(socket.create_connection(("127.0.0.1", server.port)))
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            size = b"" if b"Length" in field else b"1d4c1\r\n"  # 120,001
            connection.sendall(b"POST /encode HTTP/1.1\r\nHost: x\r\n" + field + b"\r\n\r\n" + size + 120_000 * b"a")
            until(lambda held=held: gates.uploads.held == held)  # type: ignore[misc]
        assert httpx.post(url, content=plain(255)).status_code == 201
        assert httpx.post(url, content=190_000 * b"a").status_code == 429
        assert httpx.post(url, content=iter([190_000 * b"a"])).status_code == 429
        stack.close()
        until(lambda: gates.uploads.held == 0 and gates.images.held == 0)
        assert gates.uploads.cancelled == 2
        assert httpx.post(url, content=iter([plain(255)])).status_code == 200


def test_service_under_load_keeps_its_thread_limit(model_path: Path) -> None:
    with (
        serving(hof(threads=2, model=str(model_path)), others(-1)) as (url, pid),
        httpx.Client(base_url=url, timeout=DEADLINE_S) as client,
        ThreadPoolExecutor(64) as pool,
    ):

        def visit(index: int) -> int:
            item = client.post(PATH, content=plain(index)).json()
            assert client.get(item["links"]["points"], params={"n": 20_000}).status_code == 200
            return threads(pid)

        assert max(pool.map(visit, range(64))) <= 8 + 4 * 2  # as docs/operations.md says
