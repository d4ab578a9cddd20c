"""`make replicas`: four processes on one database, killed now and then; writes benchmarks/REPLICAS.md.

Four replicas on PostgreSQL behind PgBouncer, and four workers on SQLite, do mixed operations. What was written is read
from any process, while one process after the other is killed. Then 1, 2 and 4 replicas answer as fast as they can.
About 40 minutes on two idle cores.
"""

import argparse
import asyncio
import os
import random
import tempfile
import time
from collections.abc import Awaitable, Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import aiohttp

from benchmarks.load.generator import session
from benchmarks.load.photos import photos
from benchmarks.targets import Target, targets_table
from model.provenance import provenance
from service.settings import SHIPPED_MODEL
from tests.support.resources import cpu_s
from tests.support.systems.fleets import Replicas, running_replicas, running_workers
from tests.support.systems.owners import OPERATIONS
from tests.support.systems.postgres import Postgres, running_postgres
from tests.support.systems.turmoil import CLIENTS, Turmoil, turmoil

PROCESSES: Final = 4
OPERATIONS_PER_KILL: Final = 500  # a few seconds, on two cores
SIZES: Final = (1, 2, 4)  # replicas whose rate is measured
POINTS: Final = 10_000
OBJECTS: Final = 24
LOADING: Final = 16  # clients that ask as fast as they can
POOL: Final = 16  # connections of PgBouncer to PostgreSQL
DURABLE: Final = "-c fsync=on -c synchronous_commit=on -c full_page_writes=on"  # as users run it
Ask = Callable[[aiohttp.ClientSession, str], Awaitable[None]]  # a client and the URL of a replica


@dataclass(frozen=True)
class Rate:
    """Calls a second, and processor time of a call, in ms: of the replicas, of the database, of the load."""

    per_s: float
    service_ms: float
    database_ms: float
    load_ms: float

    @property
    def total_ms(self) -> float:
        """Processor time of a call, in ms."""
        return self.service_ms + self.database_ms + self.load_ms


def main(argv: Sequence[str] | None = None) -> int:
    """Do the operations, measure the rates, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--operations", type=int, default=100_000, help="of each of the two databases")
    parser.add_argument("--kills", type=int, help=f"default: one each {OPERATIONS_PER_KILL} operations")
    parser.add_argument("--seconds", type=float, default=20, help="of each rate")
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES, help="replicas whose rates are measured")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).resolve().parents[1])
    arguments = parser.parse_args(argv)
    operations: int = arguments.operations
    kills: int = operations // OPERATIONS_PER_KILL if arguments.kills is None else arguments.kills
    run, busy = provenance(arguments.seed), os.getloadavg()[0]
    targets: list[Target] = []
    with running_postgres(DURABLE) as postgres:
        results = {
            f"{PROCESSES} replicas, PostgreSQL through PgBouncer": _on_postgres(
                postgres, operations, kills, arguments.seed
            ),
            f"{PROCESSES} workers, SQLite": _on_sqlite(operations, kills, arguments.seed),
        }
        rates = {size: _rates(postgres, size, arguments.seconds) for size in arguments.sizes}
    for name, result in results.items():
        targets += [
            Target(f"{name}: lost, doubled or wrong", len(result.report.faults), 0, at_most=True),
            Target(f"{name}: answers of 5xx but 503", result.report.server_errors, 0, at_most=True),
        ]
    page = (
        f"# Replicas: {operations:,} operations on each of two databases, amid {kills} kills\n\n"
        f"Written by `make replicas`. {run['machine']}; {run['date']}, seed {run['seed']}, commit {run['commit']}. "
        f"Load average before the start: {busy:.1f}.\n\n"
        f"{targets_table(targets)}\n\n{_kills(results)}\n\n{_throughput(rates)}\n"
    )
    (arguments.output / "REPLICAS.md").write_text(page, encoding="utf-8")
    print(page)
    return 0 if all(target.met for target in targets) else 1


@contextmanager
def _replicas(postgres: Postgres, count: int) -> Iterator[tuple[Replicas, str]]:
    """Run services on a new database behind PgBouncer; yield them and the database's own URL."""
    url = postgres.create()
    with (
        tempfile.TemporaryDirectory() as folder,
        postgres.bouncer(url, connections=POOL) as pooled,
        running_replicas(count, Path(folder), SHIPPED_MODEL, pooled) as fleet,
    ):
        yield fleet, url


def _on_postgres(postgres: Postgres, operations: int, kills: int, seed: int) -> Turmoil:
    with _replicas(postgres, PROCESSES) as (fleet, url):
        return turmoil(fleet, url, operations, kills, photos, seed)


def _on_sqlite(operations: int, kills: int, seed: int) -> Turmoil:
    with tempfile.TemporaryDirectory() as name, running_workers(PROCESSES, Path(name), SHIPPED_MODEL) as fleet:
        return turmoil(fleet, f"sqlite:///{name}/hof.db", operations, kills, photos, seed)


def _kills(results: dict[str, Turmoil]) -> str:
    rows = "\n".join(
        f"| {name} | {result.report.operations:,} | {result.took_s:.0f} | {result.kills} | "
        f"{result.took_s / max(1, result.kills):.1f} | {result.report.refused:,} | {result.report.broken:,} | "
        f"{result.objects:,} |"
        for name, result in results.items()
    )
    statuses = "\n".join(
        f"- {name}: " + ", ".join(f"{status}: {count:,}" for status, count in sorted(result.report.statuses.items()))
        for name, result in results.items()
    )
    faults = "".join(f"\n- {name}: {fault}" for name, result in results.items() for fault in result.report.faults)
    kinds = ", ".join(f"{operation.__name__[1:].replace('_', ' ')} {share}%" for operation, share in OPERATIONS.items())
    return (
        f"## Killed and started again\n\n{CLIENTS} clients, each with objects of its own, a new connection for each "
        "call, to any process. What was written is read at once, from any process. A call that broke off is repeated "
        "until it is answered. In the end the list of each process and the database itself are compared with what the "
        f"clients know.\n\nShares of the operations: {kinds}.\n\n"
        "| processes | operations | s | kills | s between kills | connections refused | calls broken off | objects "
        f"left |\n|---|---|---|---|---|---|---|---|\n{rows}\n\nAnswers by status:\n\n{statuses}{faults}"
    )


def _rates(postgres: Postgres, size: int, seconds: float) -> dict[str, Rate]:
    """Return the rates of some replicas: an object's record, its points, and new photos."""
    with _replicas(postgres, size) as (fleet, _):
        return asyncio.run(_measure(postgres, fleet, seconds))


async def _measure(postgres: Postgres, fleet: Replicas, seconds: float) -> dict[str, Rate]:
    new, draw = photos(), random.Random(0)  # noqa: S311
    ids: list[str] = []

    async def send(client: aiohttp.ClientSession, url: str) -> None:
        async with client.post(f"{url}/encode", data=next(new)) as answer:
            answer.raise_for_status()
            ids.append((await answer.json())["id"])

    async def read(client: aiohttp.ClientSession, path: str) -> None:
        async with client.get(path) as answer:
            answer.raise_for_status()
            await answer.read()

    async with session() as client:
        for number in range(OBJECTS):
            await send(client, fleet.urls[number % len(fleet.urls)])
        stored = ids[:OBJECTS]
        kinds: dict[str, Ask] = {
            "`GET /objects/{id}`": lambda client, url: read(client, f"{url}/objects/{draw.choice(stored)}"),
            f"`GET /objects/{{id}}/points`, n = {POINTS:,}": lambda client, url: read(
                client, f"{url}/objects/{draw.choice(stored)}/points?n={POINTS}"
            ),
            "`POST /encode`, new photos of 512 x 512": send,
        }
        return {name: await _rate(postgres, fleet, client, ask, seconds) for name, ask in kinds.items()}


async def _rate(postgres: Postgres, fleet: Replicas, client: aiohttp.ClientSession, ask: Ask, seconds: float) -> Rate:
    """Run LOADING clients, shared among the replicas, for some seconds."""
    groups = (fleet.pids(), postgres.pids(), [os.getpid()])
    before = [_cpu_s(pids) for pids in groups]
    start, calls = time.perf_counter(), 0

    async def one(url: str) -> None:
        nonlocal calls
        while time.perf_counter() - start < seconds:
            await ask(client, url)
            calls += 1

    await asyncio.gather(*(one(fleet.urls[number % len(fleet.urls)]) for number in range(LOADING)))
    took_s = time.perf_counter() - start
    used = [_cpu_s(pids) - earlier for pids, earlier in zip(groups, before, strict=True)]
    return Rate(calls / took_s, *(1000 * seconds / calls for seconds in used))


def _cpu_s(pids: Sequence[int]) -> float:
    """Return the processor time of processes so far; PostgreSQL ends some of its own at any time."""
    total = 0.0
    for pid in pids:
        with suppress(FileNotFoundError):
            total += cpu_s(pid)
    return total


def _throughput(rates: dict[int, dict[str, Rate]]) -> str:
    cores = os.cpu_count() or 1
    first = next(iter(rates.values()))
    rows = [
        f"| {name} | {size} | {rate.per_s:.1f} | {rate.per_s / alone.per_s:.2f} | "
        f"{rate.service_ms:.2f} | {rate.database_ms:.2f} | {rate.load_ms:.2f} | "
        f"{rate.per_s * alone.total_ms / 1000 / cores:.2f} |"
        for name, alone in first.items()
        for size in rates
        for rate in (rates[size][name],)
    ]
    return (
        f"## Throughput of {', '.join(map(str, rates))} replicas on {cores} cores\n\n{LOADING} clients; each replica "
        "is `hof serve --threads 1`, PostgreSQL with `fsync` through PgBouncer. Load and database run on the same "
        "cores. The last column is the rate over what the cores give: all cores, divided by the processor time of a "
        "call to a single replica, that of PostgreSQL and of the load included (not PgBouncer's).\n\n"
        "| call | replicas | calls/s | over one replica | ms of the service | of PostgreSQL | of the load | of what "
        "the cores give |\n|---|---|---|---|---|---|---|---|\n" + "\n".join(rows)
    )


if __name__ == "__main__":
    raise SystemExit(main())
