"""Stop and freeze PostgreSQL under a service: how long until it is unready, and how long calls take."""

import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Final

import httpx

from benchmarks.targets import Target
from service.settings import SHIPPED_MODEL
from tests.support.postgres import Postgres, running_postgres
from tests.support.processes import flags, hof_serve, is_ready

TIMEOUT_S: Final = 2.0  # --database-timeout-s
READY_S: Final = 2.0  # promised: from the fault until the service is unready
MARGIN_S: Final = 0.2  # for the way of a call through the service
CALLS: Final = 3


@contextmanager
def _stopped(postgres: Postgres) -> Iterator[None]:
    postgres.stop()
    try:
        yield
    finally:
        postgres.start()


FAULTS: Final[dict[str, Callable[[Postgres], AbstractContextManager[None]]]] = {
    "stopped": _stopped,
    "frozen": Postgres.frozen,
}


def outages(targets: list[Target], rounds: int) -> str:
    """Let PostgreSQL fail in each way, so many times, and return the page's section."""
    unready_s, call_s = 0.0, 0.0
    with running_postgres("") as postgres:
        for fault in FAULTS.values():
            for _ in range(rounds):
                unready, call = _measure(postgres, fault)
                unready_s, call_s = max(unready_s, unready), max(call_s, call)
    targets += [
        Target("PostgreSQL gone: s until the service is unready, the slowest", unready_s, READY_S, at_most=True),
        Target("PostgreSQL gone: s of a call, the slowest", call_s, TIMEOUT_S + MARGIN_S, at_most=True),
    ]
    return (
        f"## Outages: PostgreSQL {' and '.join(FAULTS)}, {rounds} times each\n\n"
        f"`--database-timeout-s {TIMEOUT_S:g}`; after each fault a probe until it gets 503, then {CALLS} calls."
    )


def _measure(postgres: Postgres, fault: Callable[[Postgres], AbstractContextManager[None]]) -> tuple[float, float]:
    """Return the seconds from a fault until the service is unready, and those of the slowest call after it."""
    with (
        tempfile.TemporaryDirectory() as name,
        hof_serve(
            Path(name), SHIPPED_MODEL, *flags(database_url=postgres.create(), database_timeout_s=TIMEOUT_S)
        ) as served,
        httpx.Client(base_url=served.url, timeout=60) as client,
        fault(postgres),
    ):
        start = time.perf_counter()
        while is_ready(served.url):
            pass
        unready = time.perf_counter() - start
        return unready, max(_failing_call_s(client) for _ in range(CALLS))


def _failing_call_s(client: httpx.Client) -> float:
    start = time.perf_counter()
    status = client.get("/objects").status_code
    if status != 503:
        raise RuntimeError(f"GET /objects answered {status} while PostgreSQL was gone")
    return time.perf_counter() - start
