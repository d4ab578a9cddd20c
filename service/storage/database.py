"""The database of objects: its tables, how it is opened, and its transactions. SQLite by default, PostgreSQL by URL."""

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
# Statements without a name and without a cache: behind PgBouncer the next transaction may have another connection.
ASYNCPG: Final[dict[str, Any]] = {
    "statement_cache_size": 0,
    "prepared_statement_cache_size": 0,
    "prepared_statement_name_func": lambda: "",
}

# What SQLite reports, by its primary result code, and what helps.
REMEDIES: Final = {
    sqlite3.SQLITE_NOTADB: "name another file, or restore a backup",
    sqlite3.SQLITE_CORRUPT: "restore a backup, or rescue what can be read with `sqlite3 OLD .recover | sqlite3 NEW`",
    sqlite3.SQLITE_READONLY: "it cannot be written: hof must be able to write the file and its folder",
    sqlite3.SQLITE_CANTOPEN: "name a file in a folder that hof can write",
    sqlite3.SQLITE_FULL: "free some space",
}
# SQLite, to which a quota is an error of input and output, and PostgreSQL (disk_full).
FULL_SQLITE: Final = {sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_WRITE, sqlite3.SQLITE_IOERR_SHMSIZE}
FULL_SQLSTATE: Final = "53100"
SQLITE_CONNECTIONS: Final = 4  # of writers one works at a time anyway
POOL_TIMEOUT_S: Final = 30  # that a call waits for one; as long as a store that is only busy counts as ready

METADATA: Final = MetaData()
objects: Final = Table(
    "objects",
    METADATA,
    # seq orders the list: the clock may stand still between two objects, or step back.
    Column("seq", BigInteger().with_variant(Integer, "sqlite"), primary_key=True, autoincrement=True),
    Column("id", String(64), nullable=False, unique=True),
    Column("kind", String(16), nullable=False),
    Column("created_at", DateTime(timezone=True), nullable=False),
    Column("model", Text, nullable=False),
    Column("spec", Text, nullable=False),
    Column("members", Text, nullable=False),  # ids of what it was made from, in order, a space between two
    Column("theta", LargeBinary),  # a composed object has none: its word is in `members`
    Column("color", LargeBinary, nullable=True),  # of what has a theta and a colour
    Column("color_spec", Text, nullable=True),  # of every object that has a colour
    sqlite_autoincrement=True,  # never reuses the seq of a deleted object: cursors stay true
)
# Each object that a word names, once: it is here that the database refuses to delete it, or to name one that is gone.
uses: Final = Table(
    "uses",
    METADATA,
    Column("composed_id", ForeignKey(objects.c.id, ondelete="CASCADE"), primary_key=True),
    Column("member_id", ForeignKey(objects.c.id, ondelete="RESTRICT"), primary_key=True),
    Index("uses_member_id", "member_id"),
)


class Database(Protocol):
    """Transactions on the connections of a pool."""

    dialect: str

    async def run(self, work: Work[R]) -> R:
        """Call a function with a connection. What it writes is on disk when this returns; nothing is if it raises.

        Raises
        ------
        sqlalchemy.exc.TimeoutError : others kept all connections for too long.
        """

    async def close(self) -> None:
        """Close all connections."""


class OnThreads:
    """SQLite, whose calls block: a transaction is one job of a thread, not a job each statement."""

    def __init__(self, engine: Engine) -> None:
        self.dialect = engine.dialect.name
        self._engine = engine
        self._threads = ThreadPoolExecutor(SQLITE_CONNECTIONS, thread_name_prefix="sqlite")
        self._free = asyncio.Semaphore(SQLITE_CONNECTIONS)

    async def run(self, work: Work[R]) -> R:
        """As `Database.run`. A transaction that has begun ends as it would, also for a client that leaves."""
        await self._acquire()
        job = asyncio.get_running_loop().run_in_executor(self._threads, self._transaction, work)
        job.add_done_callback(lambda _: self._free.release())
        return await asyncio.shield(job)

    async def _acquire(self) -> None:
        if not self._free.locked():  # a timer costs more than that
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
        """As `Database.close`, when what has begun has ended."""
        await asyncio.to_thread(self._threads.shutdown)
        self._engine.dispose()


class OnLoop:
    """PostgreSQL, whose driver waits on the event loop."""

    def __init__(self, engine: AsyncEngine) -> None:
        self.dialect = engine.dialect.name
        self._engine = engine

    async def run(self, work: Work[R]) -> R:
        """As `Database.run`."""
        async with self._engine.begin() as connection:
            return await connection.run_sync(work)

    async def close(self) -> None:
        """As `Database.close`."""
        await self._engine.dispose()


async def connect(url: str) -> Database:
    """Open `sqlite:///PATH` or `postgresql://...`; make the file and the tables where missing, migrate older ones.

    Raises
    ------
    UnusableStore : the URL is none, its driver is missing, the database does not answer or refuses, or a newer
        version made it. The message says what to do.
    """
    from service.storage.migrations import migrate  # Alembic: what opens no store starts without it

    parsed = _parse(url)
    try:
        database = _database(parsed.set(drivername=DRIVERS.get(parsed.drivername, parsed.drivername)))
        try:
            await database.run(migrate)
        except BaseException:
            await database.close()
            raise
    except Exception as error:  # each driver has classes of its own
        raise _unusable(parsed, error) from error
    return database


async def check(url: str) -> None:
    """Open a database as `connect` does, see that it can be written, read all of it where it is a file, close it.
    Raises UnusableStore."""
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
    told = connection.exec_driver_sql("PRAGMA quick_check(1)").scalar_one()
    if told != "ok":
        raise UnusableStore(f"{told.splitlines()[-1]}; {REMEDIES[sqlite3.SQLITE_CORRUPT]}")


def is_full(error: DBAPIError | PoolTimeout) -> bool:
    """Whether a write failed for want of space."""
    cause = getattr(error, "orig", None)
    return getattr(cause, "sqlite_errorcode", None) in FULL_SQLITE or getattr(cause, "sqlstate", None) == FULL_SQLSTATE


def is_busy(error: DBAPIError | PoolTimeout) -> bool:
    """Whether it was others who kept the database too long: all its connections, or SQLite's lock for writers."""
    return isinstance(error, PoolTimeout) or _is_locked(error.orig)


def _is_locked(error: BaseException | None) -> bool:
    return getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_BUSY


def _parse(url: str) -> URL:
    try:
        return make_url(url)
    except ArgumentError as error:
        raise UnusableStore("the database URL is none: sqlite:///PATH or postgresql://... is expected") from error


def _unusable(url: URL, error: Exception) -> UnusableStore:
    """What a driver says, without the pages that SQLAlchemy adds, and what helps."""
    cause = getattr(error, "orig", None) or error
    told = next(iter(str(cause).splitlines()), type(cause).__name__)
    remedy = REMEDIES.get(getattr(cause, "sqlite_errorcode", 0) & 0xFF)
    shown = url.render_as_string(hide_password=True)
    return UnusableStore(f"cannot open the database {shown}: {told}" + (f"; {remedy}" if remedy else ""))


def _database(url: URL) -> Database:
    if url.get_backend_name() != "sqlite":
        is_asyncpg = url.get_driver_name() == "asyncpg"
        connect_args = ASYNCPG if is_asyncpg else {}
        return OnLoop(
            create_async_engine(url, pool_pre_ping=True, pool_timeout=POOL_TIMEOUT_S, connect_args=connect_args)
        )
    if url.database and not url.database.startswith("file:"):  # a URI's folder is its own matter
        Path(url.database).parent.mkdir(parents=True, exist_ok=True)
    engine = create_engine(url, pool_size=SQLITE_CONNECTIONS, max_overflow=0)
    event.listen(engine, "connect", _configure_sqlite)
    return OnThreads(engine)


def _configure_sqlite(connection: DBAPIConnection, _: object) -> None:
    """Readers beside a writer (WAL); writers wait for each other; an acknowledged write is on disk (FULL)."""
    cursor = connection.cursor()
    pragmas = (
        f"busy_timeout = {BUSY_TIMEOUT_MS}",
        "journal_mode = WAL",
        "synchronous = FULL",
        "foreign_keys = ON",
    )
    for pragma in pragmas:
        _execute_patiently(cursor, f"PRAGMA {pragma}")
    cursor.close()


def _execute_patiently(cursor: DBAPICursor, statement: str) -> None:
    """Several that open a new file at once turn to WAL at once: SQLite refuses all but one without waiting."""
    until = time.monotonic() + BUSY_TIMEOUT_MS / 1000
    while True:
        try:
            cursor.execute(statement)
        except sqlite3.OperationalError as error:
            if not _is_locked(error) or time.monotonic() > until:
                raise
            time.sleep(RETRY_S)
        else:
            return
