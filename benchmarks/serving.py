"""The points of a running service: how fast, how soon, in how much memory. Over loopback, a real process."""

import os
import socket
import subprocess
import sys
import tempfile
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import httpx
import numpy as np

from benchmarks.timing import Seconds, seconds
from service.formats.weights import Weights, dump
from service.mapping import HOF_1, initial_theta
from service.sampler import sample

SPEC: Final = HOF_1.with_k(2)
LARGE: Final = 10_000_000
STREAMED: Final = 1_000_000
FIRST_BYTE_FORMATS: Final = ("ply", "npy", "xyz", "f32", "pcd", "json", "glb", "gltf")
START_TIMEOUT_S: Final = 60
MIB: Final = 2**20


@dataclass(frozen=True)
class Figures:
    """What `measure` found.

    bare_s, http_s : seconds for STREAMED points by the sampler in this process and as PLY over HTTP, (rounds,).
    first_byte_s : format -> median seconds until the first byte of STREAMED points (JSON: 100,000).
    idle_bytes, extra_bytes : the server's resident memory after a first request, and how far above it the
        peak lay while LARGE points were streamed as PLY and as GLB.
    """

    bare_s: Seconds
    http_s: Seconds
    first_byte_s: dict[str, float]
    idle_bytes: int
    extra_bytes: int


def measure(core: int, rounds: int) -> Figures:
    """Start `hof serve` with one worker thread on `core` and measure it; this process moves to another core."""
    theta = initial_theta(SPEC)
    with _serving(core) as (url, pid):
        client = httpx.Client(base_url=url, timeout=600)
        links = client.post("/objects", content=dump(Weights(SPEC, theta, "benchmark"), "safetensors")).json()["links"]
        path = links["points"]
        _drain(client, f"{path}?n={STREAMED}")
        idle = _status_bytes(pid, "VmRSS")
        _reset_peak(pid)
        for kind in ("ply", "glb"):
            _drain(client, f"{path}?n={LARGE}&format={kind}")
        extra = _status_bytes(pid, "VmHWM") - idle
        bare, http = [], []
        for _ in range(rounds):
            os.sched_setaffinity(0, {core})
            bare.append(seconds(lambda: [None for _ in sample(SPEC, [theta] * SPEC.k, STREAMED)]))
            os.sched_setaffinity(0, _others(core))
            http.append(seconds(lambda: _drain(client, f"{path}?n={STREAMED}&format=ply")))
        first = {
            kind: float(np.median([_first_byte(client, path, kind) for _ in range(rounds)]))
            for kind in FIRST_BYTE_FORMATS
        }
        os.sched_setaffinity(0, {core})
        return Figures(np.array(bare), np.array(http), first, idle, extra)


@contextmanager
def _serving(core: int) -> Iterator[tuple[str, int]]:
    with tempfile.TemporaryDirectory() as folder:
        port = _free_port()
        command = [str(Path(sys.executable).with_name("hof")), "serve", "--port", str(port), "--threads", "1"]
        settings = {"DATABASE_URL": f"sqlite:///{folder}/hof.db", "LOG_LEVEL": "warning", "DRAIN_S": "0"}
        environment = {**os.environ, **{f"HOF_{name}": value for name, value in settings.items()}}
        server = subprocess.Popen(command, env=environment)  # noqa: S603
        os.sched_setaffinity(server.pid, {core})
        try:
            _wait(f"http://127.0.0.1:{port}", server)
            yield f"http://127.0.0.1:{port}", server.pid
        finally:
            server.terminate()
            server.wait()


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port: int = probe.getsockname()[1]
    return port


def _wait(url: str, server: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + START_TIMEOUT_S
    while time.monotonic() < deadline and server.poll() is None:
        try:
            if httpx.get(f"{url}/health/ready").status_code == httpx.codes.OK:
                return
        except httpx.TransportError:
            pass
        time.sleep(0.1)
    raise RuntimeError("hof serve did not become ready")


def _drain(client: httpx.Client, path: str) -> None:
    with client.stream("GET", path) as answer:
        answer.raise_for_status()
        for _ in answer.iter_raw():
            pass


def _first_byte(client: httpx.Client, path: str, kind: str) -> float:
    """Seconds from the request to the first byte of the body. The rest is read too: what a server still
    computes for a client that left would delay the next one."""
    n = 100_000 if kind == "json" else STREAMED
    start = time.perf_counter()
    with client.stream("GET", f"{path}?n={n}&format={kind}") as answer:
        pieces = answer.iter_raw()
        next(pieces)
        took = time.perf_counter() - start
        deque(pieces, maxlen=0)
    return took


def _others(core: int) -> set[int]:
    return set(range(os.cpu_count() or 1)) - {core} or {core}


def _status_bytes(pid: int, field: str) -> int:
    for line in Path(f"/proc/{pid}/status").read_text("ascii").splitlines():
        if line.startswith(f"{field}:"):
            return int(line.split()[1]) * 1024
    raise RuntimeError(f"/proc/{pid}/status has no {field}")


def _reset_peak(pid: int) -> None:
    Path(f"/proc/{pid}/clear_refs").write_text("5", "ascii")
