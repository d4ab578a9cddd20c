"""Is anything lost? A server under write load is killed, and one is stopped, again and again; what it acknowledged is
then looked for.
"""

import itertools
import random
import signal
import sqlite3
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import httpx
import numpy as np

from benchmarks.report import Asked
from service.formats.weights import Weights, dump
from service.mapping.spec import MappingSpec, initial_theta
from service.storage.ids import composed_id
from tests.support.processes import is_ready, killable

SPEC: Final = MappingSpec("small", 3, (64,), 3, k=2)
WRITERS: Final = 4
MOST_WRITES: Final = 100  # before a kill
DRAIN_S: Final = 1.0
DEADLINE_S: Final = 120.0


@dataclass
class Ledger:
    """What was sent, and what was acknowledged.

    thetas : id -> theta's bytes, of each acknowledged object.
    words : ids of acknowledged composed objects.
    pairs : all that `mode=all` was asked for, acknowledged or not.
    broken : calls that broke off after they had been sent.
    """

    thetas: dict[str, bytes] = field(default_factory=dict)
    words: set[str] = field(default_factory=set)
    pairs: list[tuple[str, str]] = field(default_factory=list)
    broken: list[str] = field(default_factory=list)
    seeds: Iterator[int] = field(default_factory=itertools.count)


@dataclass(frozen=True)
class Stop:
    """One SIGTERM under write load: ms until a probe is told 503, and how many calls broke off after it."""

    unready_ms: float
    broken: int


def kill(database: Path, ledger: Ledger, writes: int, **settings: object) -> None:
    """Start the service, and kill it after so many new objects, amid the next writes."""
    with killable(f"sqlite:///{database}", **settings) as served, _writing(served.url, ledger):
        _wait_for(ledger, len(ledger.thetas) + writes)
        served.process.kill()
        served.process.wait()


def stop(database: Path, ledger: Ledger, **settings: object) -> Stop:
    """Start the service, write, send SIGTERM, and write until no connection is taken any more."""
    ledger.broken.clear()
    with killable(f"sqlite:///{database}", drain_s=DRAIN_S, **settings) as served, _writing(served.url, ledger):
        _wait_for(ledger, len(ledger.thetas) + WRITERS)
        served.process.send_signal(signal.SIGTERM)
        start = time.perf_counter()
        while is_ready(served.url):
            pass
        unready = time.perf_counter() - start
        served.process.wait()
    return Stop(1000 * unready, len(ledger.broken))


def lost(database: Path, ledger: Ledger, url: str | None = None) -> list[str]:
    """What was acknowledged and is not there as it was sent, and what is there by half; of a server's `url` too."""
    connection = sqlite3.connect(f"file:{database}?mode=ro", uri=True)
    try:
        found = {name: (kind, theta) for name, kind, theta in connection.execute("SELECT id, kind, theta FROM objects")}
        integrity = connection.execute("PRAGMA integrity_check").fetchone()[0]
    finally:
        connection.close()
    faults = [] if integrity == "ok" else [integrity]
    faults += [name for name, theta in ledger.thetas.items() if found.get(name) != ("imported", theta)]
    faults += [word for word in ledger.words if found.get(word) != ("composed", None)]
    for pair in ledger.pairs:
        kept = [composed_id(word) in found for word in itertools.product(pair, repeat=SPEC.k)]
        faults += [f"some words of {pair}"] if any(kept) and not all(kept) else []
    if url is not None:
        with httpx.Client(base_url=url, timeout=60) as client:
            for name, theta in itertools.islice(reversed(ledger.thetas.items()), 20):
                answer = client.get(f"/objects/{name}/weights", params={"format": "npy"})
                faults += [] if answer.is_success and answer.content.endswith(theta) else [f"{url}: {name}"]
    return faults


@contextmanager
def _writing(url: str, ledger: Ledger) -> Iterator[None]:
    """Clients that write at once, from before the block until the server has gone."""
    threads = [threading.Thread(target=_write, args=(url, ledger)) for _ in range(WRITERS)]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        for thread in threads:
            thread.join()


def _wait_for(ledger: Ledger, count: int) -> None:
    """Until so many objects are acknowledged. Raises TimeoutError where they never are."""
    deadline = time.monotonic() + DEADLINE_S
    while len(ledger.thetas) < count:
        if time.monotonic() > deadline:
            raise TimeoutError(
                f"{len(ledger.thetas)} of {count} objects are acknowledged; broken: {ledger.broken[-3:]}"
            )
        time.sleep(0.001)


def _write(url: str, ledger: Ledger) -> None:
    """Two objects and all their words, again and again, until no connection is taken."""
    with httpx.Client(base_url=url, timeout=60) as client:
        while True:
            try:
                pair = (_post(client, ledger), _post(client, ledger))
                ledger.pairs.append(pair)
                answer = client.post("/compose", json={"objects": pair, "mode": "all"}).raise_for_status()
                ledger.words.update(item["id"] for item in answer.json()["objects"])
            except httpx.ConnectError:
                return
            except httpx.HTTPError as error:
                ledger.broken.append(repr(error))


def _post(client: httpx.Client, ledger: Ledger) -> str:
    theta = initial_theta(SPEC, next(ledger.seeds))
    answer = client.post("/objects", content=dump(Weights(SPEC, theta, "kills"), "safetensors")).raise_for_status()
    name: str = answer.json()["id"]
    ledger.thetas[name] = theta.tobytes()
    return name


def faults(asked: list[Asked], kills: int, stops: int) -> str:
    """Kill it so many times and stop it so many times, and count what is missing."""
    draw, ledger, missing = random.Random(0), Ledger(), 0  # noqa: S311
    with tempfile.TemporaryDirectory() as folder:
        database = Path(folder) / "hof.db"
        for _ in range(kills):
            kill(database, ledger, draw.randrange(MOST_WRITES))
            missing += len(lost(database, ledger))
        stopped = [stop(database, ledger) for _ in range(stops)]
        missing += len(lost(database, ledger))
    unready = np.array([each.unready_ms for each in stopped])
    asked += [
        Asked(f"{kills} kills: acknowledged objects that are lost or half there", missing, 0, at_most=True),
        Asked("stopped: ms until it is unready, the slowest", float(unready.max()), 100, at_most=True),
        Asked("stopped: calls that broke off", sum(each.broken for each in stopped), 0, at_most=True),
    ]
    return (
        f"## Faults: SIGKILL {kills} times, SIGTERM {stops} times, amid the writes of {WRITERS} clients\n\n"
        f"Acknowledged: {len(ledger.thetas):,} objects and {len(ledger.words):,} words of them; after each end all are "
        f"looked for. Unready after SIGTERM: {np.median(unready):.1f} ms, the median."
    )
