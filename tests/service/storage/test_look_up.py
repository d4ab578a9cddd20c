"""Rows that SQLite reads by their keys, on the event loop."""

import asyncio
import sqlite3
import threading
from pathlib import Path

from sqlalchemy import Connection
from sqlalchemy.exc import OperationalError

from service.mapping.spec import Functions
from service.storage.database import connect
from tests.support.small.store import THETA, encoded_record, open_store


def test_find_record_sees_what_another_store_wrote_and_deleted(tmp_path: Path) -> None:
    async def scenario() -> None:
        url = f"sqlite:///{tmp_path / 'hof.db'}"
        async with open_store(url) as one, open_store(url) as two:
            assert await one.find_record("a") is None
            await two.put(encoded_record("a"), Functions(THETA))
            assert await one.find_record("a") == encoded_record("a")
            await two.relabel("a", "chair")
            record = await one.find_record("a")
            assert record is not None
            assert record.label == "chair"
            await two.delete("a")
            assert await one.find_record("a") is None

    asyncio.run(scenario())


def test_find_record_while_another_process_writes_does_not_wait(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with open_store(f"sqlite:///{tmp_path / 'hof.db'}") as store:
            await store.put(encoded_record("a"), Functions(THETA))
            writer = sqlite3.connect(tmp_path / "hof.db", isolation_level=None)
            writer.execute("BEGIN EXCLUSIVE")
            writer.execute("DELETE FROM objects")
            async with asyncio.timeout(5):  # a writer waits for 10 s
                assert await store.find_record("a") == encoded_record("a")
            writer.close()

    asyncio.run(scenario())


def test_look_up_in_a_locked_file_moves_to_a_thread(tmp_path: Path) -> None:
    async def scenario() -> None:
        event_loop = threading.get_ident()

        def thread_or_lock(_: Connection) -> int:
            if threading.get_ident() == event_loop:
                raise OperationalError("SELECT 1", {}, sqlite3.OperationalError("database is locked"))
            return threading.get_ident()

        database = await connect(f"sqlite:///{tmp_path / 'hof.db'}")
        try:
            assert await database.look_up(lambda _: threading.get_ident()) == event_loop
            assert await database.look_up(thread_or_lock) != event_loop
        finally:
            await database.close()

    asyncio.run(scenario())
