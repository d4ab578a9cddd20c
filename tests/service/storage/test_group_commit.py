"""Writes that share a transaction of SQLite."""

import asyncio
import sqlite3
import threading
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import Connection, event
from sqlalchemy.exc import OperationalError

from service.errors import Overloaded
from service.mapping.spec import Functions
from service.storage.database import connect
from service.storage.group_commit import GroupCommit
from service.storage.sqlite import SqliteDatabase
from service.storage.store import Store
from service.storage.transactions import Work
from tests.support.small.store import THETA, encoded_record, open_store

WAIT_S = 60


class _Hold:
    """A write that keeps its transaction open until `go_on` is set."""

    def __init__(self) -> None:
        self.begun, self.go_on = threading.Event(), threading.Event()

    def work(self, connection: Connection) -> None:
        self.begun.set()
        assert self.go_on.wait(WAIT_S)


async def _behind(hold: _Hold, database: SqliteDatabase, *works: Work[Any]) -> list[asyncio.Task[Any]]:
    """Return tasks that write, of which all but the first wait for its transaction to end."""
    tasks = [asyncio.create_task(database.write(hold.work))]
    assert await asyncio.to_thread(hold.begun.wait, WAIT_S)
    tasks += [asyncio.create_task(database.write(work)) for work in works]
    await asyncio.sleep(0)  # each has asked for its turn
    return tasks


async def _open(path: Path) -> SqliteDatabase:
    database = await connect(f"sqlite:///{path}")
    assert isinstance(database, SqliteDatabase)
    await database.run(lambda connection: connection.exec_driver_sql("CREATE TABLE names (name)"))
    return database


def _add(name: str, connection: Connection) -> str:
    connection.exec_driver_sql("INSERT INTO names VALUES (?)", (name,))
    return name


def _names(path: Path) -> set[str]:
    with closing(sqlite3.connect(path)) as connection:
        return {name for (name,) in connection.execute("SELECT name FROM names")}


def _database_of(store: Store) -> SqliteDatabase:
    assert isinstance(store._database, SqliteDatabase)
    return store._database


def test_write_while_another_is_written_shares_the_next_transaction(tmp_path: Path) -> None:
    commits = []

    async def scenario() -> None:
        database, hold = await _open(tmp_path / "hof.db"), _Hold()
        event.listen(database._engine, "commit", lambda _: commits.append(_names(tmp_path / "hof.db")))
        first, *others = await _behind(hold, database, *(partial(_add, f"name{number}") for number in range(5)))
        hold.go_on.set()
        await first
        assert await asyncio.gather(*others) == [f"name{number}" for number in range(5)]
        assert len(_names(tmp_path / "hof.db")) == 5  # on disk by then
        await database.close()

    asyncio.run(scenario())
    assert len(commits) == 2


def test_write_that_comes_alone_does_not_wait_for_others(tmp_path: Path) -> None:
    async def scenario() -> None:
        database = await _open(tmp_path / "hof.db")
        for number in range(3):
            assert await database.write(partial(_add, f"name{number}")) == f"name{number}"
            assert f"name{number}" in _names(tmp_path / "hof.db")
        await database.close()

    asyncio.run(scenario())


def test_write_that_fails_in_a_group_fails_alone_and_changes_nothing(tmp_path: Path) -> None:
    def halfway(connection: Connection) -> None:
        _add("halfway", connection)
        raise RuntimeError("halfway")

    async def scenario() -> None:
        database, hold = await _open(tmp_path / "hof.db"), _Hold()
        works = partial(_add, "name0"), halfway, partial(_add, "name1")
        first, *others = await _behind(hold, database, *works)
        hold.go_on.set()
        await first
        one, fault, two = await asyncio.gather(*others, return_exceptions=True)
        assert (one, str(fault), two) == ("name0", "halfway", "name1")
        await database.close()

    asyncio.run(scenario())
    assert _names(tmp_path / "hof.db") == {"name0", "name1"}


def test_put_of_an_existing_id_in_a_group_leaves_the_others_new(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with open_store(f"sqlite:///{tmp_path / 'hof.db'}") as store:
            await store.put(encoded_record("b"), Functions(THETA))
            hold = _Hold()
            (first,) = await _behind(hold, _database_of(store))
            puts = [asyncio.create_task(store.put(encoded_record(name), Functions(THETA))) for name in "abca"]
            await asyncio.sleep(0)
            hold.go_on.set()
            await first
            assert [is_new for _, is_new in await asyncio.gather(*puts)] == [True, False, True, False]
            assert await store.count() == 3

    asyncio.run(scenario())


def test_write_of_a_cancelled_call_is_written_with_those_of_the_others(tmp_path: Path) -> None:
    async def scenario() -> None:
        database, hold = await _open(tmp_path / "hof.db"), _Hold()
        works = partial(_add, "name0"), partial(_add, "name1"), partial(_add, "name2")
        first, one, two, three = await _behind(hold, database, *works)
        for call in (first, two):
            call.cancel()
            with pytest.raises(asyncio.CancelledError):
                await call
        hold.go_on.set()
        assert [await one, await three] == ["name0", "name2"]
        await database.close()

    asyncio.run(scenario())
    assert _names(tmp_path / "hof.db") == {"name0", "name1", "name2"}


def test_group_whose_commit_fails_is_written_one_by_one(tmp_path: Path) -> None:
    """A deferred foreign key fails at the commit, as a full disk may."""

    def orphan(connection: Connection) -> None:
        connection.exec_driver_sql("PRAGMA defer_foreign_keys = ON")
        connection.exec_driver_sql("INSERT INTO uses VALUES ('nobody', 'nothing')")

    async def scenario() -> None:
        database, hold = await _open(tmp_path / "hof.db"), _Hold()
        first, *others = await _behind(hold, database, partial(_add, "name0"), orphan, partial(_add, "name1"))
        hold.go_on.set()
        await first
        one, fault, two = await asyncio.gather(*others, return_exceptions=True)
        assert (one, two) == ("name0", "name1")
        assert "FOREIGN KEY constraint failed" in str(fault)
        await database.close()

    asyncio.run(scenario())
    assert _names(tmp_path / "hof.db") == {"name0", "name1"}


def test_group_in_a_locked_file_waits_once_for_all(tmp_path: Path) -> None:
    waits = []

    def locked(work: Work[Any]) -> None:
        waits.append(work)
        reason = sqlite3.OperationalError("database is locked")
        reason.sqlite_errorcode = sqlite3.SQLITE_BUSY
        raise OperationalError("INSERT", {}, reason)

    async def scenario() -> None:
        commits = GroupCommit(locked)
        store = Store(await _open(tmp_path / "hof.db"))
        _database_of(store)._writes = commits
        puts = [store.put(encoded_record(name), Functions(THETA)) for name in "abc"]
        faults = await asyncio.gather(*puts, return_exceptions=True)
        assert [type(fault) for fault in faults] == [Overloaded] * 3
        await store.close()

    asyncio.run(scenario())
    assert len(waits) == 1


def test_write_after_close_is_refused(tmp_path: Path) -> None:
    async def scenario() -> None:
        database = await _open(tmp_path / "hof.db")
        await database.close()
        with pytest.raises(RuntimeError, match="after shutdown"):
            await database.write(partial(_add, "late"))

    asyncio.run(scenario())
