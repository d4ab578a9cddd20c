"""Points of a running service, a real process over loopback: rate, time to the first byte, memory."""

import os
import time
from collections import deque
from dataclasses import dataclass
from typing import Final

import httpx
import numpy as np

from benchmarks.speed.timing import Seconds, seconds
from service.formats.weights import Weights, dump
from service.mapping.sampler import sample
from service.mapping.spec import HOF_1, initial_theta
from tests.support.processes import hof, serving
from tests.support.resources import others, reset_peak, status_bytes

SPEC: Final = HOF_1.with_k(2)
LARGE: Final = 10_000_000
STREAMED: Final = 1_000_000
FIRST_BYTE_FORMATS: Final = ("ply", "npy", "xyz", "f32", "pcd", "json", "glb", "gltf")
MIB: Final = 2**20


@dataclass(frozen=True)
class Figures:
    """Figures of a running service.

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
    with serving(hof(threads=1), {core}) as (url, pid):
        client = httpx.Client(base_url=url, timeout=600)
        links = client.post("/objects", content=dump(Weights(SPEC, theta, "benchmark"), "safetensors")).json()["links"]
        path = links["points"]
        _drain(client, f"{path}?n={STREAMED}")
        idle = status_bytes(pid, "VmRSS")
        reset_peak(pid)
        for kind in ("ply", "glb"):
            _drain(client, f"{path}?n={LARGE}&format={kind}")
        extra = status_bytes(pid, "VmHWM") - idle
        bare, http = [], []
        for _ in range(rounds):
            os.sched_setaffinity(0, {core})
            bare.append(seconds(lambda: [None for _ in sample(SPEC, [theta] * SPEC.k, STREAMED)]))
            os.sched_setaffinity(0, others(core))
            http.append(seconds(lambda: _drain(client, f"{path}?n={STREAMED}&format=ply")))
        first = {
            kind: float(np.median([_first_byte(client, path, kind) for _ in range(rounds)]))
            for kind in FIRST_BYTE_FORMATS
        }
        os.sched_setaffinity(0, {core})
        return Figures(np.array(bare), np.array(http), first, idle, extra)


def _drain(client: httpx.Client, path: str) -> None:
    with client.stream("GET", path) as answer:
        answer.raise_for_status()
        for _ in answer.iter_raw():
            pass


def _first_byte(client: httpx.Client, path: str, kind: str) -> float:
    """Return the seconds from the request to the first byte of the body.

    The rest is read too: work that a server still does for a client that left would delay the next request.
    """
    n = 100_000 if kind == "json" else STREAMED
    start = time.perf_counter()
    with client.stream("GET", f"{path}?n={n}&format={kind}") as answer:
        pieces = answer.iter_raw()
        next(pieces)
        took = time.perf_counter() - start
        deque(pieces, maxlen=0)
    return took
