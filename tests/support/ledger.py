"""Kill or stop a server under write load, and look in its database for all that it acknowledged."""

import itertools
import signal
import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import httpx

from service.formats.weights import Weights, dump
from service.mapping.spec import MappingSpec, initial_theta
from service.settings import SHIPPED_MODEL
from service.storage.ids import composed_id
from tests.support.processes import flags, hof_serve, is_ready

SPEC: Final = MappingSpec("small", 3, (64,), 3, k=2)
WRITERS: Final = 4
DRAIN_S: Final = 1.0
DEADLINE_S: Final = 120.0


@dataclass
class Ledger:
    """Writes that were sent and that were acknowledged.

    thetas : id -> theta's bytes, of each acknowledged object.
    words : ids of acknowledged composed objects.
    pairs : the objects of each call with `mode=all`, acknowledged or not.
    broken : errors of calls that broke off after they had been sent.
    """

    thetas: dict[str, bytes] = field(default_factory=dict)
    words: set[str] = field(default_factory=set)
    pairs: list[tuple[str, str]] = field(default_factory=list)
    broken: list[str] = field(default_factory=list)
    seeds: Iterator[int] = field(default_factory=itertools.count)


@dataclass(frozen=True)
class Stop:
    """One SIGTERM under write load: ms until a probe gets 503, and how many calls broke off after it."""

    unready_ms: float
    broken: int


def kill(folder: Path, ledger: Ledger, writes: int, model: Path = SHIPPED_MODEL) -> None:
    """Start the service, and kill it after so many new objects, amid the next writes."""
    with hof_serve(folder, model) as served, _writing(served.url, ledger):
        _wait_for(ledger, len(ledger.thetas) + writes)
        served.process.kill()
        served.process.wait()


def stop(folder: Path, ledger: Ledger, model: Path = SHIPPED_MODEL, workers: int = 1) -> Stop:
    """Start the service, write, send SIGTERM, and write until it accepts no connection."""
    ledger.broken.clear()
    with hof_serve(folder, model, *flags(drain_s=DRAIN_S, workers=workers)) as served, _writing(served.url, ledger):
        _wait_for(ledger, len(ledger.thetas) + WRITERS)
        served.process.send_signal(signal.SIGTERM)
        start = time.perf_counter()
        while is_ready(served.url):
            pass
        unready = time.perf_counter() - start
        served.process.wait()
    return Stop(1000 * unready, len(ledger.broken))


def lost(folder: Path, ledger: Ledger, url: str | None = None) -> list[str]:
    """Return the ids of acknowledged objects that the store lacks or holds otherwise, and of words kept in part.

    Parameters
    ----------
    url : a server's, whose answers for the newest objects are compared too.

    """
    connection = sqlite3.connect(f"file:{folder / 'hof.db'}?mode=ro", uri=True)
    try:
        rows = {name: (kind, theta) for name, kind, theta in connection.execute("SELECT id, kind, theta FROM objects")}
        integrity = connection.execute("PRAGMA integrity_check").fetchone()[0]
    finally:
        connection.close()
    faults = [] if integrity == "ok" else [integrity]
    faults += [name for name, theta in ledger.thetas.items() if rows.get(name) != ("imported", theta)]
    faults += [word for word in ledger.words if rows.get(word) != ("composed", None)]
    for pair in ledger.pairs:
        kept = [composed_id(word) in rows for word in itertools.product(pair, repeat=SPEC.k)]
        faults += [f"some words of {pair}"] if any(kept) and not all(kept) else []
    if url is not None:
        with httpx.Client(base_url=url, timeout=60) as client:
            for name, theta in itertools.islice(reversed(ledger.thetas.items()), 20):
                answer = client.get(f"/objects/{name}/weights", params={"format": "npy"})
                faults += [] if answer.is_success and answer.content.endswith(theta) else [f"{url}: {name}"]
    return faults


@contextmanager
def _writing(url: str, ledger: Ledger) -> Iterator[None]:
    """Run clients that write, from before the block until the server has gone."""
    threads = [threading.Thread(target=_write, args=(url, ledger)) for _ in range(WRITERS)]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        for thread in threads:
            thread.join()


def _wait_for(ledger: Ledger, count: int) -> None:
    """Wait until so many objects are acknowledged. Raises TimeoutError after DEADLINE_S."""
    deadline = time.monotonic() + DEADLINE_S
    while len(ledger.thetas) < count:
        if time.monotonic() > deadline:
            raise TimeoutError(
                f"{len(ledger.thetas)} of {count} objects are acknowledged; broken: {ledger.broken[-3:]}"
            )
        time.sleep(0.001)


def _write(url: str, ledger: Ledger) -> None:
    """Write two objects and all their words, again and again, until no connection is accepted."""
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
