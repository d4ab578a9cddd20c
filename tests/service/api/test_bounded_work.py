"""Calls that would make the service work or remember without a bound, against a real process of its own."""

import asyncio
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import httpx
import numpy as np
import pytest

from service.encoding.encoder import Encoder
from service.formats.weights import Weights, dump
from service.mapping.spec import HOF_1, Array, Functions, MappingSpec, initial_theta
from service.runtime.batcher import MAX_BATCH
from service.settings import SHIPPED_MODEL
from service.storage.ids import imported_id
from service.storage.rows import Record
from tests.support.processes import Served, hof_serve
from tests.support.resources import reset_peak, status_bytes
from tests.support.slow import DEADLINE_S, until
from tests.support.small.store import open_store

MIB = 2**20
SIZE = Encoder.open(SHIPPED_MODEL, threads=1).framing.size
STALL = 10  # of the loop, in times of the longest beside sound inferences; the faults were 60 and more
INFER = "/v2/models/hof1-k2/infer"
ANSWER_BYTES = 16 * MIB  # the limit on answers, in the test of unread ones


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """Serve the shipped model, whose inferences take the largest bodies, in a process of its own."""
    with hof_serve(tmp_path_factory.mktemp("bounded"), SHIPPED_MODEL) as served:
        _infer(served, _request([0.5] * (3 * SIZE**2))).raise_for_status()
        yield served


def _request(data: object, **members: object) -> bytes:
    image = {"name": "image", "shape": [1, 3, SIZE, SIZE], "datatype": "FP32", "data": data}
    return json.dumps({"inputs": [image | members]}).encode()


def _infer(served: Served, body: bytes) -> httpx.Response:
    return httpx.post(served.url + INFER, content=body, timeout=DEADLINE_S)


def _with_data(data: bytes) -> bytes:
    return _request("DATA").replace(b'"DATA"', data)


def _members(count: int) -> bytes:
    return b",".join(b'"m%d":1' % number for number in range(count))


PAIRS = 3_000_000
BODIES: dict[str, Callable[[], bytes]] = {
    "strings": lambda: _request(["x" * 100_000] + ["y"] * 4_000),
    "as many strings as numbers": lambda: _request(["x" * 100_000] + ["y"] * (3 * SIZE**2 - 1)),
    "empty lists": lambda: _with_data(b"[" + b"[]," * PAIRS + b"[]]"),
    "empty objects": lambda: _with_data(b"[" + b"{}," * PAIRS + b"{}]"),
    "nested lists": lambda: _with_data(b"[" + b",".join([b"[" * 100 + b"]" * 100] * 40_000) + b"]"),
    "deep": lambda: _with_data(b"[" * 4_000_000 + b"]" * 4_000_000),
    "unknown members": lambda: b"{" + _members(700_000) + b"}",
    "unknown members of an input": lambda: _request([0]).replace(b'"data"', _members(600_000) + b',"data"'),
    "unknown parameters": lambda: _request([0], parameters="P").replace(b'"P"', b"{" + _members(500_000) + b"}"),
    "duplicate members": lambda: b'{"inputs":[],' + b'"id":"a",' * 900_000 + b'"id":"a"}',
    "a shape of strings": lambda: _request([0], shape=["3"] * 350_000),
    "a shape of numbers": lambda: _request([0], shape=[3] * 350_000),
    "a long integer": lambda: _with_data(b"[" + b"9" * 9_000_000 + b"]"),
    "long integers": lambda: _with_data(b"[" + b",".join([b"9" * 4_000] * 2_000) + b"]"),
    "long fractions": lambda: _with_data(b"[0." + b"1" * 9_000_000 + b"]"),
    "a long string": lambda: b'{"id":"' + b"\\u00e9" * 1_400_000 + b'","inputs":[]}',
    "a long name": lambda: b'{"' + b"n" * 9_000_000 + b'":1}',
    "numbers out of range": lambda: _request([10**100] * (3 * SIZE**2)),
}


@contextmanager
def _probes(url: str) -> Iterator[list[float]]:
    """Ask for `/health/live` again and again; seconds that the answers took."""
    ended, seconds = threading.Event(), list[float]()

    def ask() -> None:
        with httpx.Client(base_url=url, timeout=DEADLINE_S) as client:
            while not seconds or not ended.wait(0.005):
                start = time.perf_counter()
                assert client.get("/health/live").status_code == 200
                seconds.append(time.perf_counter() - start)

    with ThreadPoolExecutor(1) as pool:
        probing = pool.submit(ask)
        try:
            yield seconds
        finally:
            ended.set()
            probing.result()


@pytest.fixture(scope="module")
def sound_stall_s(served: Served) -> float:
    """Seconds of the slowest probe beside the largest inference that is allowed: eight images as JSON."""
    numbers = np.random.default_rng(0).random(MAX_BATCH * 3 * SIZE**2).tolist()
    body = _request(numbers, shape=[MAX_BATCH, 3, SIZE, SIZE])
    with _probes(served.url) as seconds:
        for _ in range(3):
            assert _infer(served, body).status_code == 200
    return max(seconds)


@pytest.mark.parametrize("name", BODIES)
def test_infer_of_a_hostile_body_takes_less_than_a_sound_one(served: Served, sound_stall_s: float, name: str) -> None:
    pid, body = served.process.pid, BODIES[name]()
    before = status_bytes(pid, "VmRSS")
    reset_peak(pid)
    with _probes(served.url) as seconds:
        answer = _infer(served, body)
    assert answer.status_code in (400, 422), answer.text[:300]
    assert answer.headers["content-type"] == "application/problem+json"
    assert len(answer.content) < 2_000
    assert status_bytes(pid, "VmHWM") - before < 80 * MIB
    assert max(seconds) < STALL * sound_stall_s


FORM_HEAD = b'--x\r\nContent-Disposition: form-data; name="image"; filename="a"\r\n\r\n'
FORMS: dict[str, Callable[[], bytes]] = {
    "boundaries that are data": lambda: FORM_HEAD + b"\r\n--xA" * 3_000_000,
    "boundaries that begin to end": lambda: FORM_HEAD + b"\r\n--x-A" * 2_800_000,
    "spaces after a boundary": lambda: FORM_HEAD + b"abc\r\n--x" + b" " * 19_000_000,
    "tiny fields": lambda: (FORM_HEAD + b"\r\n") * 270_000,
}


@pytest.mark.parametrize("name", FORMS)
def test_hostile_form_takes_less_than_a_sound_inference(served: Served, sound_stall_s: float, name: str) -> None:
    body, headers = FORMS[name](), {"Content-Type": "multipart/form-data; boundary=x"}
    with _probes(served.url) as seconds:
        answer = httpx.post(f"{served.url}/encode", content=body, headers=headers, timeout=DEADLINE_S)
    assert answer.status_code == 400
    assert len(answer.content) < 2_000
    assert max(seconds) < STALL * sound_stall_s


def test_unread_surfaces_hold_bounded_memory_until_the_client_timeout(tmp_path: Path) -> None:
    limits = ("--client-timeout-s=6", f"--max-answer-bytes={ANSWER_BYTES}", "--max-points-in-flight=100000000")
    with (
        hof_serve(tmp_path, SHIPPED_MODEL, *limits) as served,
        httpx.Client(base_url=served.url, timeout=DEADLINE_S) as client,
        ExitStack() as stack,
    ):
        pid, spec = served.process.pid, HOF_1.with_k(2)
        path = f"{client.post('/objects', content=_file(spec)).json()['links']['mesh']}?resolution=80&format=obj"
        whole = len(client.get(path).content)
        before = status_bytes(pid, "VmRSS")
        reset_peak(pid)
        unread = [stack.enter_context(_unread(served.url, path)) for _ in range(12)]
        heads = [connection.recv(12) for connection in unread]
        assert {head[9:] for head in heads} == {b"200", b"429"}
        assert status_bytes(pid, "VmHWM") - before < ANSWER_BYTES + 3 * whole
        until(lambda: client.get(path).status_code == 200)  # it has room again
        left = [_bytes_left(connection) for connection in unread]
        assert any(head.endswith(b"200") and count < whole for head, count in zip(heads, left, strict=True))


def _unread(url: str, path: str) -> socket.socket:
    """Return a connection with a small buffer that has sent a request."""
    host, port = url.removeprefix("http://").split(":")
    connection = socket.socket()
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_096)
    connection.settimeout(DEADLINE_S)
    connection.connect((host, int(port)))
    connection.sendall(f"GET {path} HTTP/1.1\r\nHost: x\r\n\r\n".encode())
    return connection


def _bytes_left(connection: socket.socket) -> int:
    """Return how many bytes come until the server has ended the connection."""
    count = 0
    with suppress(ConnectionResetError):
        while piece := connection.recv(MIB):
            count += len(piece)
    return count


def test_compose_of_large_functions_is_admitted_before_they_are_read(tmp_path: Path) -> None:
    large = replace(HOF_1, hidden=(700, 700), k=16)
    ids = asyncio.run(_stored(tmp_path, large, 16))
    with (
        hof_serve(tmp_path, SHIPPED_MODEL) as served,
        httpx.Client(base_url=served.url, timeout=DEADLINE_S) as client,
    ):
        pid = served.process.pid
        assert client.post("/objects", content=_file(large)).json()["id"] == ids[0]  # what the first call allocates
        before = status_bytes(pid, "VmRSS")
        reset_peak(pid)

        def compose(turn: int) -> int:
            body = {"objects": ids[turn:] + ids[:turn]}
            return httpx.post(f"{served.url}/compose", json=body, timeout=DEADLINE_S).status_code

        with ThreadPoolExecutor(12) as pool:
            assert set(pool.map(compose, range(12))) == {201, 429}
        assert status_bytes(pid, "VmHWM") - before < 5 * 16 * 4 * large.size  # one call's functions, and copies


async def _stored(folder: Path, spec: MappingSpec, count: int) -> list[str]:
    """Store functions in the database that `hof_serve` will open, without the seconds that each import takes."""
    pairs = []
    for seed in range(count):
        functions = Functions(_theta(spec, seed))
        id_ = imported_id(spec, functions)
        pairs.append((Record(id_, "imported", "m", spec, datetime.now(UTC)), functions))
    async with open_store(f"sqlite:///{folder / 'hof.db'}") as store:
        records, _ = await store.put_all(pairs)
    return [record.id for record in records]


def _theta(spec: MappingSpec, seed: int) -> Array:
    return 0.5 * initial_theta(spec, seed)


def _file(spec: MappingSpec, seed: int = 0) -> bytes:
    return dump(Weights(spec, _theta(spec, seed), "m"), "safetensors")
