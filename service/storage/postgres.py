"""PostgreSQL: transactions on a small pool of connections, none of which takes longer than a limit."""

import asyncio
import contextlib
import time
from typing import TYPE_CHECKING, Any, Final

from sqlalchemy import Connection, text
from sqlalchemy.exc import TimeoutError as PoolTimeout

from service.errors import StoreUnavailable, UnusableStore
from service.storage.faults import is_read_only, no_answer, read_only, too_busy
from service.storage.postgres_url import PostgresUrl
from service.storage.transactions import R, Work

if TYPE_CHECKING:
    from sqlalchemy.ext.asyncio import AsyncEngine

# Unnamed, uncached statements: behind PgBouncer the next transaction may use another connection.
ASYNCPG: Final[dict[str, Any]] = {
    "statement_cache_size": 0,
    "prepared_statement_cache_size": 0,
    "prepared_statement_name_func": lambda: "",
}
MAX_SILENCE_S: Final = 0.9  # without any answer for so long, the service is not ready
CLOSE_TIMEOUT_S: Final = 2.0


class PostgresDatabase:
    """PostgreSQL, whose driver uses the event loop.

    Parameters
    ----------
    timeout_s : longest time of a transaction, with the wait for a connection.
    """

    max_silence_s = MAX_SILENCE_S

    def __init__(self, engine: "AsyncEngine", timeout_s: float) -> None:
        self.dialect = engine.dialect.name
        self._engine = engine
        self._timeout_s = timeout_s
        self._answered_at = time.monotonic()
        self._running: set[asyncio.Task[Any]] = set()

    async def run(self, work: Work[R], *, timeout_s: float | None = None) -> R:
        """Run a transaction (`Database.run`).

        A task of its own, because the driver cleans a frozen connection up for seconds before it lets go of it; the
        caller does not wait for that.
        """
        limit = timeout_s or self._timeout_s
        began = time.monotonic()
        transaction = asyncio.create_task(self._transaction(work))
        self._running.add(transaction)
        transaction.add_done_callback(self._end)
        try:
            await asyncio.wait((transaction,), timeout=limit)
        finally:
            transaction.cancel()  # does nothing to a task that has ended
        try:
            if transaction.done():
                return transaction.result()
        except PoolTimeout:
            pass
        raise too_busy() if self._answered_at > began else no_answer(limit)

    async def look_up(self, work: Work[R]) -> R:
        """Run a transaction (`Database.look_up`)."""
        return await self.run(work)

    async def write(self, work: Work[R]) -> R:
        """Run a transaction (`Database.write`)."""
        return await self.run(work)

    def _end(self, transaction: asyncio.Task[Any]) -> None:
        self._running.discard(transaction)
        if not transaction.cancelled():
            transaction.exception()  # retrieved here, for those that nobody waits for

    async def _transaction(self, work: Work[R]) -> R:
        async with self._engine.begin() as connection:
            try:
                result = await connection.run_sync(work)
            except Exception as error:
                # The next call connects anew, and of several hosts finds the one that accepts writes.
                if is_read_only(error) or isinstance(error, StoreUnavailable):
                    await connection.invalidate()
                raise
        self._answered_at = time.monotonic()
        return result

    def ping(self, connection: Connection) -> None:
        """Raise StoreUnavailable if the database accepts no writes."""
        if connection.execute(text("SELECT current_setting('transaction_read_only')")).scalar_one() == "on":
            raise read_only()

    async def close(self) -> None:
        """Close all connections; a database that does not answer is not waited for."""
        for transaction in self._running:
            transaction.cancel()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(CLOSE_TIMEOUT_S):
                await self._engine.dispose()


def check_may_create(connection: Connection) -> None:
    """Raise UnusableStore if the user may not create tables."""
    if not connection.execute(text("SELECT has_schema_privilege(current_schema(), 'CREATE')")).scalar_one():
        raise UnusableStore("its user may not create tables; grant CREATE on the schema to the user")


def open_postgres(url: PostgresUrl, timeout_s: float, connections: int) -> PostgresDatabase:
    """Return a database of at most so many connections; the first transaction connects."""
    from sqlalchemy.ext.asyncio import create_async_engine  # imports SQLAlchemy's ORM, which nothing else needs

    limit = min(timeout_s, url.connect_timeout_s or timeout_s)
    engine = create_async_engine(
        "postgresql+asyncpg://",
        pool_size=connections,
        max_overflow=0,
        pool_pre_ping=True,
        pool_timeout=timeout_s,
        connect_args={**ASYNCPG, **url.arguments, "timeout": limit},
    )
    return PostgresDatabase(engine, timeout_s)
