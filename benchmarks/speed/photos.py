"""Photos over HTTP: processor time of a new and of a repeated photo, and what a start takes."""

import os
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import httpx
import numpy as np

from benchmarks.load.photos import photos
from benchmarks.speed.timing import Seconds
from service.encoding.encoder import Encoder
from service.settings import SHIPPED_MODEL
from tests.support.processes import hof, serving
from tests.support.resources import cpu_s, others, status_bytes

CALLS: Final = 200  # of each kind in a round
CLIENTS: Final = 8  # for new photos: as many as a call of the encoder takes


@dataclass(frozen=True)
class Figures:
    """Figures of a running service with both shipped models.

    live_s, repeat_s, new_s : processor time of the server for `GET /health/live`, a repeated photo and a new photo,
        (rounds,).
    encode_s : processor time of the encoder alone for an image, in calls of `CLIENTS` images, (rounds,).
    ready_s : from the start of the process until it is ready, to a tenth of a second, (rounds,).
    idle_bytes : resident memory then.
    """

    live_s: Seconds
    repeat_s: Seconds
    new_s: Seconds
    encode_s: Seconds
    ready_s: Seconds
    idle_bytes: int


def measure(core: int, rounds: int) -> Figures:
    """Start `hof serve` with one worker thread on `core` and measure it from another core."""
    os.sched_setaffinity(0, others(core))
    ready_s = [_ready_s(core) for _ in range(rounds - 1)]
    encoder, pictures = Encoder.open(SHIPPED_MODEL, threads=1), photos()
    images = np.repeat(encoder.blank(), CLIENTS, axis=0)
    repeated = next(pictures)

    def alone() -> None:
        for _ in range(CALLS // CLIENTS):
            encoder.encode(images)

    start = time.perf_counter()
    with serving(hof(threads=1), {core}) as (url, pid), ThreadPoolExecutor(CLIENTS) as pool:
        ready_s.append(time.perf_counter() - start)
        idle = status_bytes(pid, "VmRSS")
        client = httpx.Client(base_url=url, timeout=60)
        calls: dict[str, Callable[[], object]] = {
            "live": lambda: [client.get("/health/live") for _ in range(CALLS)],
            "repeat": lambda: [_post(client, repeated) for _ in range(CALLS)],
            "new": lambda: list(pool.map(lambda _: _post(client, next(pictures)), range(CALLS))),
        }
        _post(client, repeated)
        table = []
        for _ in range(rounds):
            os.sched_setaffinity(0, others(core))
            row = [_processor_s(lambda: cpu_s(pid), run) for run in calls.values()]
            os.sched_setaffinity(0, {core})
            row.append(_processor_s(time.process_time, alone))
            table.append(row)
        live, repeat, new, encode = np.array(table).T
        return Figures(live, repeat, new, encode, np.array(ready_s), idle)


def _ready_s(core: int) -> float:
    start = time.perf_counter()
    with serving(hof(threads=1), {core}):
        return time.perf_counter() - start


def _processor_s(clock: Callable[[], float], run: Callable[[], object]) -> float:
    """Return the processor time of one of the CALLS calls that `run` makes."""
    before = clock()
    run()
    return (clock() - before) / CALLS


def _post(client: httpx.Client, photo: bytes) -> httpx.Response:
    return client.post("/encode", content=photo).raise_for_status()
