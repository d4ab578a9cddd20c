"""Ways in which a PostgreSQL fails under a service: each a block, at whose end it works again."""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Final

import asyncpg  # type: ignore[import-untyped]

from tests.support.systems.postgres import USER, Postgres

MAX_CONNECTIONS: Final = 12  # of a server for these faults: few, because one of them takes all
TERMINATE: Final = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = '{name}'"
Fault = Callable[[Postgres, str], AbstractContextManager[None]]  # a server and the name of the service's database


@contextmanager
def stopped(postgres: Postgres, name: str) -> Iterator[None]:
    """Stop the server."""
    postgres.stop()
    try:
        yield
    finally:
        postgres.start()


@contextmanager
def frozen(postgres: Postgres, name: str) -> Iterator[None]:
    """Freeze the server's processes: it accepts connections and answers nothing."""
    with postgres.frozen():
        yield


@contextmanager
def read_only(postgres: Postgres, name: str) -> Iterator[None]:
    """Let the server refuse writes, as a standby does."""
    postgres.run("ALTER SYSTEM SET default_transaction_read_only = on", "postgres")
    postgres.run("SELECT pg_reload_conf()", "postgres")
    try:
        yield
    finally:
        postgres.run("ALTER SYSTEM RESET default_transaction_read_only", "postgres")
        postgres.run("SELECT pg_reload_conf()", "postgres")


@contextmanager
def without_connections(postgres: Postgres, name: str) -> Iterator[None]:
    """Hold all connections of the server, those of the service too."""
    with asyncio.Runner() as runner:
        held = runner.run(_take_connections(postgres, name))
        try:
            yield
        finally:
            for connection in held:
                runner.run(connection.close())


async def _take_connections(postgres: Postgres, name: str) -> list[asyncpg.Connection]:
    held: list[asyncpg.Connection] = []
    terminated = 0
    while terminated < 3:  # the service connects again between the first one and the next connection
        try:
            held.append(await asyncpg.connect(f"postgresql://{USER}@127.0.0.1:{postgres.port}/postgres"))
        except asyncpg.TooManyConnectionsError:
            await held[0].execute(TERMINATE.format(name=name))
            terminated += 1
            await asyncio.sleep(0.1)
    return held


FAULTS: Final[dict[str, Fault]] = {
    "stopped": stopped,
    "frozen": frozen,
    "read-only": read_only,
    "without connections": without_connections,
}
