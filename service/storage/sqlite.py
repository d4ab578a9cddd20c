"""SQLite: opening a file, transactions on threads, and noticing that the file is gone."""

import asyncio
import contextlib
import os
import sqlite3
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Final

from sqlalchemy import Connection, Engine, create_engine, event, select
from sqlalchemy.engine import URL
from sqlalchemy.engine.interfaces import DBAPIConnection, DBAPICursor
from sqlalchemy.exc import OperationalError

from service.errors import StoreUnavailable, UnusableStore
from service.storage.faults import REMEDIES, RETRY_AFTER_S, is_locked, too_busy
from service.storage.group_commit import GroupCommit
from service.storage.transactions import R, Work

SQLITE_CONNECTIONS: Final = 4  # more would not help: SQLite has one writer at a time
OWN: Final = 2  # connections besides: that of the event loop, and that of the thread that writes
POOL_TIMEOUT_S: Final = 30  # wait for a connection; as long as a busy file still counts as ready
BUSY_TIMEOUT_MS: Final = 10_000
BUSY_TIMEOUT: Final = f"busy_timeout = {BUSY_TIMEOUT_MS}"
RETRY_S: Final = 0.01
OWNER_ONLY: Final = 0o600  # SQLite gives its -wal and -shm the mode of the file

Identity = tuple[int, int]  # device and inode


class SqliteDatabase:
    """SQLite, whose calls block: each transaction runs as one job on a thread."""

    max_silence_s = float(POOL_TIMEOUT_S)

    def __init__(self, engine: Engine) -> None:
        self.dialect = engine.dialect.name
        self._engine = engine
        self._threads = ThreadPoolExecutor(SQLITE_CONNECTIONS, thread_name_prefix="sqlite")
        self._free = asyncio.Semaphore(SQLITE_CONNECTIONS)
        self._writes = GroupCommit(self._transaction)
        self._connections: dict[int, Connection] = {}  # by thread: a pool would cost as much as reading a row
        self._reader: Connection | None = None  # of the event loop; opened by `watch_files`
        self._files: dict[Path, Identity | None] = {}

    async def run(self, work: Work[R], *, timeout_s: float | None = None) -> R:
        """Run a transaction (`Database.run`). Once begun, it completes even if the caller is cancelled.

        Raises
        ------
        StoreUnavailable : the file, or its write-ahead log, was deleted or replaced while it was open.
        """
        await self._acquire()
        loop = asyncio.get_running_loop()
        outcome: asyncio.Future[R] = loop.create_future()
        self._threads.submit(self._run_on_thread, work, loop, outcome)
        return await outcome

    def _run_on_thread(self, work: Work[R], loop: asyncio.AbstractEventLoop, outcome: asyncio.Future[R]) -> None:
        """Run a transaction, and settle the outcome on the event loop: cheaper than `run_in_executor`."""
        try:
            settle = partial(outcome.set_result, self._transaction(work))
        except Exception as error:
            settle = partial(outcome.set_exception, error)

        def end() -> None:
            self._free.release()
            if not outcome.done():  # the caller was canceled
                settle()

        loop.call_soon_threadsafe(end)

    async def look_up(self, work: Work[R]) -> R:
        """Read a few rows (`Database.look_up`) on the event loop: a thread and back takes as long as the read itself.

        A reader waits for no writer (WAL). If the file is locked all the same, a thread waits in its place.
        """
        if self._reader is not None:
            with contextlib.suppress(OperationalError):
                return self._transact(self._reader, work)
        return await self.run(work)

    async def write(self, work: Work[R]) -> R:
        """Run a transaction that others may share (`Database.write`)."""
        return await self._writes.write(work)

    async def _acquire(self) -> None:
        if not self._free.locked():  # saves the timer, which costs more than the acquisition
            await self._free.acquire()
            return
        try:
            async with asyncio.timeout(POOL_TIMEOUT_S):
                await self._free.acquire()
        except TimeoutError:
            raise too_busy() from None

    def _transaction(self, work: Work[R]) -> R:
        thread = threading.get_ident()
        connection = self._connections.get(thread) or self._engine.connect()
        self._connections[thread] = connection
        try:
            return self._transact(connection, work)
        except BaseException:
            self._connections.pop(thread).close()  # the next transaction begins with a clean one
            raise

    def _transact(self, connection: Connection, work: Work[R]) -> R:
        with connection.begin():
            result = work(connection)
        # After the commit: a file that vanished before it took the transaction along.
        for path, identity in self._files.items():
            if _identity(path) != identity:
                raise StoreUnavailable(
                    f"the database file {path.name} was deleted or replaced while the service ran; put it back, or "
                    "restart the service to use what is there now",
                    retry_after_s=RETRY_AFTER_S,
                )
        return result

    async def watch_files(self) -> None:
        """Remember the open file and its write-ahead log; from now on, transactions on other files fail."""
        path = await self.run(_path)
        if path:  # none for a database in memory
            self._reader = await asyncio.to_thread(self._open_reader)
            files = {Path(f"{path}{suffix}"): _identity(Path(f"{path}{suffix}")) for suffix in ("", "-wal")}
            self._files = {file: identity for file, identity in files.items() if identity}

    def _open_reader(self) -> Connection:
        """Return a connection that waits for no lock."""
        reader = self._engine.connect()
        with reader.begin():
            reader.exec_driver_sql("PRAGMA busy_timeout = 0")
        return reader

    def ping(self, connection: Connection) -> None:
        """Run SELECT 1."""
        connection.execute(select(1))

    async def close(self) -> None:
        """Close all connections once the running transactions have ended."""
        await asyncio.to_thread(self._threads.shutdown)
        await asyncio.to_thread(self._writes.close)
        for connection in (*self._connections.values(), *([self._reader] if self._reader else [])):
            connection.close()
        self._engine.dispose()


def expand(name: str) -> Path:
    """Return the path of a database file, `~` replaced by the home folder. Raises UnusableStore if there is none."""
    path = Path(os.path.expanduser(name))  # Path.expanduser raises RuntimeError instead
    if path.parts[:1] == ("~",):
        raise UnusableStore(
            "this user has no home folder; set --database-url or HOF_DATABASE_URL to another file, for example "
            "sqlite:////var/lib/hof/hof.db"
        )
    return path


def open_sqlite(url: URL, *, unchanged: bool = False) -> SqliteDatabase:
    """Return a SQLite database; its file is created, for its owner alone, if it is missing.

    Parameters
    ----------
    unchanged : do not switch the file to WAL; it must exist.

    Raises
    ------
    UnusableStore : the path is in the user's home folder, and there is none.
    OSError : the file's folder cannot be created.
    """
    if url.database and not url.database.startswith("file:"):  # the user creates a URI's file
        path = expand(url.database)
        path.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(OSError):  # SQLite says it with a remedy
            os.close(os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL, OWNER_ONLY))
        url = url.set(database=str(path))
    engine = create_engine(url, pool_size=SQLITE_CONNECTIONS + OWN, max_overflow=0)
    event.listen(engine, "connect", _configure_unchanged if unchanged else _configure)
    return SqliteDatabase(engine)


def check_file(connection: Connection) -> None:
    """Read all of a file. Raises UnusableStore if it is damaged."""
    result = connection.exec_driver_sql("PRAGMA quick_check(1)").scalar_one()
    if result != "ok":
        raise UnusableStore(f"{result.splitlines()[-1]}; {REMEDIES[sqlite3.SQLITE_CORRUPT]}")


def _path(connection: Connection) -> str:
    """Return the path of the open file; empty for a database in memory."""
    path: str = connection.exec_driver_sql("PRAGMA database_list").all()[0][2]
    return path


def _identity(path: Path) -> Identity | None:
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_dev, status.st_ino


def _configure(connection: DBAPIConnection, _: object) -> None:
    """Let readers work beside a writer (WAL), writers wait for each other, and commits reach the disk (FULL)."""
    _set_pragmas(connection, BUSY_TIMEOUT, "journal_mode = WAL", "synchronous = FULL", "foreign_keys = ON")


def _configure_unchanged(connection: DBAPIConnection, _: object) -> None:
    _set_pragmas(connection, BUSY_TIMEOUT)


def _set_pragmas(connection: DBAPIConnection, *pragmas: str) -> None:
    cursor = connection.cursor()
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
            if not is_locked(error) or time.monotonic() > deadline:
                raise
            time.sleep(RETRY_S)
        else:
            return
