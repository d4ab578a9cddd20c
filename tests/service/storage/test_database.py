"""The database: opening, transactions, and files that are refused at start."""

import asyncio
import sqlite3
import subprocess
import threading
from collections.abc import Callable
from contextlib import closing
from functools import partial
from pathlib import Path

import pytest
from sqlalchemy import Connection

from service.errors import UnusableStore
from service.mapping.spec import HOF_1, Functions, initial_theta
from service.storage.database import connect, verify
from service.storage.rows import Record
from service.storage.sqlite import SQLITE_CONNECTIONS
from tests.support.processes import HOF
from tests.support.small.store import NOW, open_store
from tests.support.systems.postgres import Postgres


async def _put(url: str, count: int) -> list[bool]:
    """Put objects at once and read them at once; return which of them were new."""
    records = [Record(f"object{number % 7}", "encoded", "m", HOF_1, NOW) for number in range(count)]
    functions = Functions(initial_theta(HOF_1))
    async with open_store(url) as store:
        new = [new for _, new in await asyncio.gather(*[store.put(record, functions) for record in records])]
        await asyncio.gather(*[store.get(record.id) for record in records])
    return new


def _scalar(query: str, connection: Connection) -> object:
    return connection.exec_driver_sql(query).scalar()


def test_connect_to_sqlite_sets_wal_full_sync_and_foreign_keys(tmp_path: Path) -> None:
    async def scenario() -> None:
        database = await connect(f"sqlite:///{tmp_path / 'new' / 'folder' / 'hof.db'}")
        pragmas = [("journal_mode", "wal"), ("synchronous", 2), ("busy_timeout", 10_000), ("foreign_keys", 1)]
        for pragma, expected in pragmas:
            assert await database.run(partial(_scalar, f"PRAGMA {pragma}")) == expected
        await database.close()

    asyncio.run(scenario())


def test_connect_to_a_new_file_waits_for_another_writer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """SQLite refuses to switch a locked file to WAL, whatever its busy_timeout."""
    path, refused = tmp_path / "hof.db", threading.Event()
    with closing(sqlite3.connect(path, isolation_level=None, check_same_thread=False)) as other:
        other.execute("BEGIN IMMEDIATE")
        other.execute("CREATE TABLE others (number)")
        with closing(sqlite3.connect(path)) as second, pytest.raises(sqlite3.OperationalError, match="locked"):
            second.execute("PRAGMA journal_mode = WAL")

        def commit(_: float) -> None:
            if other.in_transaction:
                other.execute("COMMIT")
                refused.set()

        monkeypatch.setattr("service.storage.sqlite.time.sleep", commit)  # called after each refusal
        asyncio.run(asyncio.run(connect(f"sqlite:///{path}")).close())
        assert refused.is_set()
    with closing(sqlite3.connect(path)) as after:
        assert after.execute("PRAGMA journal_mode").fetchone() == ("wal",)
        assert after.execute("SELECT count(*) FROM others").fetchone() == (0,)


def test_run_of_a_cancelled_call_completes_the_transaction(tmp_path: Path) -> None:
    begun, go_on = threading.Event(), threading.Event()

    def slow(number: int, connection: Connection) -> None:
        begun.set()
        assert go_on.wait(60)
        connection.exec_driver_sql(f"CREATE TABLE made{number} (it)")

    async def scenario() -> None:
        database = await connect(f"sqlite:///{tmp_path / 'hof.db'}")
        for number in range(SQLITE_CONNECTIONS + 1):  # each gives its connection back
            begun.clear()
            go_on.clear()
            call = asyncio.create_task(database.run(partial(slow, number)))
            assert await asyncio.to_thread(begun.wait, 60)
            call.cancel()
            with pytest.raises(asyncio.CancelledError):
                await call
            go_on.set()
        await database.close()

    asyncio.run(scenario())
    with closing(sqlite3.connect(tmp_path / "hof.db")) as connection:
        tables = "SELECT count(*) FROM sqlite_master WHERE name LIKE 'made%'"
        assert connection.execute(tables).fetchone() == (SQLITE_CONNECTIONS + 1,)


def test_run_that_raises_changes_nothing(tmp_path: Path) -> None:
    def halfway(connection: Connection) -> None:
        connection.exec_driver_sql("DELETE FROM alembic_version")
        raise RuntimeError("halfway")

    async def scenario() -> None:
        database = await connect(f"sqlite:///{tmp_path / 'hof.db'}")
        with pytest.raises(RuntimeError, match="halfway"):
            await database.run(halfway)
        assert await database.run(partial(_scalar, "SELECT count(*) FROM alembic_version")) == 1
        await database.close()

    asyncio.run(scenario())


def test_connect_through_pgbouncer_pooling_transactions_works(postgres: Postgres) -> None:
    with postgres.bouncer(postgres.create()) as url:
        assert sum(asyncio.run(_put(url, 40))) == 7


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _overwrite(path: Path, start: int, data: bytes) -> None:
    with path.open("r+b") as file:
        file.seek(start)
        file.write(data)


def _make_folder(path: Path) -> None:
    path.unlink()
    path.mkdir()


BACKUP = "restore a backup"


def _text(path: Path) -> None:
    path.write_text("no database" * 1000)


@pytest.mark.parametrize(
    ("damage", "query", "reason", "remedy"),
    [
        (_text, "", "file is not a database", BACKUP),
        (lambda path: _overwrite(path, 0, bytes(200)), "", "file is not a database", BACKUP),
        (_cut, "", "malformed", BACKUP),
        (lambda path: _overwrite(path, 8192, b"\xff" * 4096), "", "", BACKUP),
        (lambda path: _overwrite(path, path.stat().st_size // 4096 // 2 * 4096, b"\xff" * 4096), "", "", BACKUP),
        (_make_folder, "", "unable to open database file", "name a file in a folder that hof can write"),
        (lambda path: None, "?mode=ro&uri=true", "readonly database", "hof must be able to write the file"),
    ],
    ids=["text", "header", "cut", "third page", "middle page", "folder", "read-only"],
)
def test_verify_of_a_damaged_file_raises_in_one_line_with_a_remedy(
    damage: Callable[[Path], None], query: str, reason: str, remedy: str, tmp_path: Path
) -> None:
    path = tmp_path / "hof.db"
    asyncio.run(_put(f"sqlite:///{path}", 7))
    damage(path)
    with pytest.raises(UnusableStore) as caught:
        asyncio.run(verify(f"sqlite:///{'file:' if query else ''}{path}{query}"))
    detail = caught.value.detail
    assert detail.startswith("cannot open the database sqlite:///")
    assert "\n" not in detail
    assert reason in detail
    assert remedy in detail
    assert {each.name[:6] for each in tmp_path.iterdir()} == {"hof.db"}  # no other file was created


@pytest.mark.server
@pytest.mark.parametrize("damage", [_text, _cut, _make_folder])
def test_serve_with_a_damaged_file_is_refused_with_what_verify_says(
    damage: Callable[[Path], None], tmp_path: Path, model_path: Path
) -> None:
    path = tmp_path / "hof.db"
    asyncio.run(_put(f"sqlite:///{path}", 7))
    damage(path)
    with pytest.raises(UnusableStore) as caught:
        asyncio.run(verify(f"sqlite:///{path}"))
    run = subprocess.run(
        [HOF, "serve", "--port=0", f"--model={model_path}", f"--database-url=sqlite:///{path}"],
        capture_output=True,
        text=True,
        timeout=60,
        cwd=tmp_path,
    )
    assert (run.returncode, run.stderr) == (2, f"hof: {caught.value.detail}\n")
    assert {each.name[:6] for each in tmp_path.iterdir()} == {"hof.db"}


def test_connect_to_an_intact_file_keeps_its_objects(tmp_path: Path) -> None:
    asyncio.run(_put(f"sqlite:///{tmp_path / 'hof.db'}", 7))
    assert asyncio.run(_put(f"sqlite:///{tmp_path / 'hof.db'}", 7)) == [False] * 7
    connection = sqlite3.connect(tmp_path / "hof.db")
    assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    connection.close()
