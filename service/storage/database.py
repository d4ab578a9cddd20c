"""The database: tables, opening, transactions. SQLite by default, PostgreSQL by URL."""

import asyncio
import sqlite3
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, Final, Protocol, TypeVar

from sqlalchemy import (
    BigInteger,
    Column,
    Connection,
    DateTime,
    Engine,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    Text,
    create_engine,
    event,
    make_url,
)
from sqlalchemy.engine import URL
from sqlalchemy.engine.interfaces import DBAPIConnection, DBAPICursor
from sqlalchemy.exc import ArgumentError, DBAPIError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from sqlalchemy.ext.asyncio import AsyncEngine, create_async_engine

from service.errors import UnusableStore

R = TypeVar("R")
Work = Callable[[Connection], R]

DRIVERS: Final = {"postgresql": "postgresql+asyncpg"}
BUSY_TIMEOUT_MS: Final = 10_000
RETRY_S: Final = 0.01
# Unnamed, uncached statements: behind PgBouncer the next transaction may use another connection.
ASYNCPG: Final[dict[str, Any]] = {
    "statement_cache_size": 0,
    "prepared_statement_cache_size": 0,
    "prepared_statement_name_func": lambda: "",
}

# What to do, by SQLite's primary result code.
REMEDIES: Final = {
    sqlite3.SQLITE_NOTADB: "name another file, or restore a backup",
    sqlite3.SQLITE_CORRUPT: "restore a backup, or rescue what can be read with `sqlite3 OLD .recover | sqlite3 NEW`",
    sqlite3.SQLITE_READONLY: "it cannot be written: hof must be able to write the file and its folder",
    sqlite3.SQLITE_CANTOPEN: "name a file in a folder that hof can write",
    sqlite3.SQLITE_FULL: "free some space",
}
# SQLite reports an exceeded quota as an input/output error.
FULL_SQLITE: Final = {sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_WRITE, sqlite3.SQLITE_IOERR_SHMSIZE}
FULL_SQLSTATE: Final = "53100"  # PostgreSQL: disk_full
SQLITE_CONNECTIONS: Final = 4  # more would not help: SQLite has one writer at a time
POOL_TIMEOUT_S: Final = 30  # wait for a connection; as long as a busy store still counts as ready

METADATA: Final = MetaData()
objects: Final = Table(
    "objects",
    METADATA,
    # seq orders the list: two objects may have the same time, and the clock may step back.
    Column("seq", BigInteger().with_variant(Integer, "sqlite"), primary_key=True, autoincrement=True),
    Column("id", String(64), nullable=False, unique=True),
    Column("kind", String(16), nullable=False),
    Column("created_at", DateTime(timezone=True), nullable=False),
    Column("model", Text, nullable=False),
    Column("spec", Text, nullable=False),
    Column("members", Text, nullable=False),  # ids of the objects it was made from, in order, separated by spaces
    Column("theta", LargeBinary),  # NULL for a composed object: its word is in `members`
    Column("color", LargeBinary, nullable=True),  # NULL without color, and for a composed object
    Column("color_spec", Text, nullable=True),  # NULL without color
    sqlite_autoincrement=True,  # never reuses the seq of a deleted object: cursors stay valid
)
# One row per object of a word. Its foreign keys stop the deletion of a used object, and words over deleted objects.
uses: Final = Table(
    "uses",
    METADATA,
    Column("composed_id", ForeignKey(objects.c.id, ondelete="CASCADE"), primary_key=True),
    Column("member_id", ForeignKey(objects.c.id, ondelete="RESTRICT"), primary_key=True),
    Index("uses_member_id", "member_id"),
)


class Database(Protocol):
    """Transactions on a pool of connections."""

    dialect: str

    async def run(self, work: Work[R]) -> R:
        """Call a function with a connection, in a transaction: on disk when this returns, undone if it raises.

        Raises
        ------
        sqlalchemy.exc.TimeoutError : no connection was free within POOL_TIMEOUT_S.
        """

    async def close(self) -> None:
        """Close all connections."""


class SqliteDatabase:
    """SQLite, whose calls block: each transaction runs as one job on a thread."""

    def __init__(self, engine: Engine) -> None:
        self.dialect = engine.dialect.name
        self._engine = engine
        self._threads = ThreadPoolExecutor(SQLITE_CONNECTIONS, thread_name_prefix="sqlite")
        self._free = asyncio.Semaphore(SQLITE_CONNECTIONS)

    async def run(self, work: Work[R]) -> R:
        """Run a transaction (`Database.run`). Once begun, it completes even if the caller is cancelled."""
        await self._acquire()
        job = asyncio.get_running_loop().run_in_executor(self._threads, self._transaction, work)
        job.add_done_callback(lambda _: self._free.release())
        return await asyncio.shield(job)

    async def _acquire(self) -> None:
        if not self._free.locked():  # saves the timer, which costs more than the acquisition
            await self._free.acquire()
            return
        try:
            async with asyncio.timeout(POOL_TIMEOUT_S):
                await self._free.acquire()
        except TimeoutError:
            raise PoolTimeout(f"no connection was free for {POOL_TIMEOUT_S} s") from None

    def _transaction(self, work: Work[R]) -> R:
        with self._engine.begin() as connection:
            return work(connection)

    async def close(self) -> None:
        """Close all connections once the running transactions have ended."""
        await asyncio.to_thread(self._threads.shutdown)
        self._engine.dispose()


class PostgresDatabase:
    """PostgreSQL, whose driver uses the event loop."""

    def __init__(self, engine: AsyncEngine) -> None:
        self.dialect = engine.dialect.name
        self._engine = engine

    async def run(self, work: Work[R]) -> R:
        """Run a transaction (`Database.run`)."""
        async with self._engine.begin() as connection:
            return await connection.run_sync(work)

    async def close(self) -> None:
        """Close all connections."""
        await self._engine.dispose()


async def connect(url: str) -> Database:
    """Open `sqlite:///PATH` or `postgresql://...`; create a missing file and tables, migrate older tables.

    Raises
    ------
    UnusableStore : the URL is invalid, its driver is missing, the database does not answer or refuses, or a newer
        version of hof wrote it. The message says what to do.
    """
    from service.storage.migrations import migrate  # imports Alembic, which commands without a store do not need

    parsed = _parse(url)
    try:
        database = _database(parsed.set(drivername=DRIVERS.get(parsed.drivername, parsed.drivername)))
        try:
            await database.run(migrate)
        except BaseException:
            await database.close()
            raise
    except Exception as error:  # each driver has its own classes
        raise _unusable(parsed, error) from error
    return database


async def verify(url: str) -> None:
    """Open a database as `connect` does, test that it can be written, read all of a SQLite file, and close it.

    Raises
    ------
    UnusableStore : the database cannot be opened, written or read; the message says what to do.
    """
    database = await connect(url)
    try:
        await database.run(lambda connection: connection.execute(objects.delete().where(objects.c.id == "")))
        if database.dialect == "sqlite":
            await database.run(_check_file)
    except Exception as error:
        raise _unusable(_parse(url), error) from error
    finally:
        await database.close()


def _check_file(connection: Connection) -> None:
    result = connection.exec_driver_sql("PRAGMA quick_check(1)").scalar_one()
    if result != "ok":
        raise UnusableStore(f"{result.splitlines()[-1]}; {REMEDIES[sqlite3.SQLITE_CORRUPT]}")


def is_full(error: DBAPIError | PoolTimeout) -> bool:
    """Return whether a write failed because no space is left."""
    cause = getattr(error, "orig", None)
    return getattr(cause, "sqlite_errorcode", None) in FULL_SQLITE or getattr(cause, "sqlstate", None) == FULL_SQLSTATE


def is_busy(error: DBAPIError | PoolTimeout) -> bool:
    """Return whether other calls held all connections, or SQLite's write lock, for too long."""
    return isinstance(error, PoolTimeout) or _is_locked(error.orig)


def _is_locked(error: BaseException | None) -> bool:
    return getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_BUSY


def _parse(url: str) -> URL:
    try:
        return make_url(url)
    except ArgumentError as error:
        raise UnusableStore(
            "invalid database URL; expected sqlite:///PATH or postgresql://USER:PASSWORD@HOST/NAME"
        ) from error


def _unusable(url: URL, error: Exception) -> UnusableStore:
    """Build an UnusableStore from the first line of the driver's message and a remedy."""
    cause = getattr(error, "orig", None) or error
    reason = next(iter(str(cause).splitlines()), type(cause).__name__)
    remedy = REMEDIES.get(getattr(cause, "sqlite_errorcode", 0) & 0xFF)
    shown = url.render_as_string(hide_password=True)
    return UnusableStore(f"cannot open the database {shown}: {reason}" + (f"; {remedy}" if remedy else ""))


def _database(url: URL) -> Database:
    if url.get_backend_name() != "sqlite":
        is_asyncpg = url.get_driver_name() == "asyncpg"
        connect_args = ASYNCPG if is_asyncpg else {}
        return PostgresDatabase(
            create_async_engine(url, pool_pre_ping=True, pool_timeout=POOL_TIMEOUT_S, connect_args=connect_args)
        )
    if url.database and not url.database.startswith("file:"):  # the user creates a URI's folder
        Path(url.database).parent.mkdir(parents=True, exist_ok=True)
    engine = create_engine(url, pool_size=SQLITE_CONNECTIONS, max_overflow=0)
    event.listen(engine, "connect", _configure_sqlite)
    return SqliteDatabase(engine)


def _configure_sqlite(connection: DBAPIConnection, _: object) -> None:
    """Let readers work beside a writer (WAL), writers wait for each other, and commits reach the disk (FULL)."""
    cursor = connection.cursor()
    pragmas = (
        f"busy_timeout = {BUSY_TIMEOUT_MS}",
        "journal_mode = WAL",
        "synchronous = FULL",
        "foreign_keys = ON",
    )
    for pragma in pragmas:
        _execute_when_unlocked(cursor, f"PRAGMA {pragma}")
    cursor.close()


def _execute_when_unlocked(cursor: DBAPICursor, statement: str) -> None:
    """Repeat a statement while the file is locked.

    SQLite does not wait by itself when several processes open a new file and switch to WAL at once.
    """
    deadline = time.monotonic() + BUSY_TIMEOUT_MS / 1000
    while True:
        try:
            cursor.execute(statement)
        except sqlite3.OperationalError as error:
            if not _is_locked(error) or time.monotonic() > deadline:
                raise
            time.sleep(RETRY_S)
        else:
            return
