"""Let PostgreSQL fail under a service: how long until it is unready, and how long calls take."""

import tempfile
import time
from pathlib import Path
from typing import Final

import httpx

from benchmarks.targets import Target
from service.formats.weights import Weights, dump
from service.mapping.spec import HOF_1, initial_theta
from service.settings import SHIPPED_MODEL
from tests.support.processes import flags, hof_serve, is_ready
from tests.support.slow import until
from tests.support.systems.postgres import Postgres, running_postgres
from tests.support.systems.postgres_faults import FAULTS, MAX_CONNECTIONS, Fault

TIMEOUT_S: Final = 2.0  # --database-timeout-s
READY_S: Final = 2.0  # promised: from the fault until the service is unready
MARGIN_S: Final = 0.2  # for the way of a call through the service
CONNECTIONS: Final = 3  # of the service: less than the server's
CALLS: Final = 3
SPEC: Final = HOF_1.with_k(2)


def outages(targets: list[Target], rounds: int) -> str:
    """Let PostgreSQL fail in each way, so many times, and return the page's section."""
    rows = []
    with running_postgres(f"-c max_connections={MAX_CONNECTIONS}") as postgres:
        for name, fault in FAULTS.items():
            times = _measure(postgres, fault, rounds)
            rows.append((name, *(max(each) for each in zip(*times, strict=True))))
    unready_s, call_s = max(row[1] for row in rows), max(row[2] for row in rows)
    targets += [
        Target("PostgreSQL gone: s until the service is unready, the slowest", unready_s, READY_S, at_most=True),
        Target("PostgreSQL gone: s of a call, the slowest", call_s, TIMEOUT_S + MARGIN_S, at_most=True),
    ]
    lines = "\n".join(f"| {name} | {unready:.2f} | {call:.2f} |" for name, unready, call in rows)
    return (
        f"## Outages: PostgreSQL fails in {len(FAULTS)} ways, {rounds} times each\n\n"
        f"`--database-timeout-s {TIMEOUT_S:g}`; after each fault a probe until it gets 503, then {CALLS} "
        f"`POST /objects`. The slowest:\n\n| PostgreSQL | s until unready | s of a call |\n|---|---|---|\n{lines}"
    )


def _measure(postgres: Postgres, fault: Fault, rounds: int) -> list[tuple[float, float]]:
    """Return for each round the seconds from a fault until the service is unready, and those of its slowest call."""
    url = postgres.create()
    settings = flags(database_url=url, database_timeout_s=TIMEOUT_S, database_connections=CONNECTIONS)
    with (
        tempfile.TemporaryDirectory() as name,
        hof_serve(Path(name), SHIPPED_MODEL, *settings) as served,
        httpx.Client(base_url=served.url, timeout=60) as client,
    ):
        times = []
        for _ in range(rounds):
            with fault(postgres, url.rpartition("/")[2]):
                start = time.perf_counter()
                while is_ready(served.url):
                    pass
                unready_s = time.perf_counter() - start
                times.append((unready_s, max(_failing_call_s(client) for _ in range(CALLS))))
            until(lambda: is_ready(served.url))
        return times


def _failing_call_s(client: httpx.Client) -> float:
    body = dump(Weights(SPEC, initial_theta(SPEC), "m"), "safetensors")
    start = time.perf_counter()
    status = client.post("/objects", content=body).status_code
    if status != 503:
        raise RuntimeError(f"POST /objects answered {status} while PostgreSQL was at fault")
    return time.perf_counter() - start
