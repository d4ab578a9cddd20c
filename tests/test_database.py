"""The database: how it is opened, and which one is refused."""

import asyncio
import sqlite3
from pathlib import Path

import pytest

from service.database import connect
from service.errors import UnusableStore


def test_sqlite_syncs_its_log_before_a_commit_returns_and_holds_foreign_keys(tmp_path: Path) -> None:
    async def scenario() -> None:
        engine = await connect(f"sqlite:///{tmp_path / 'new' / 'folder' / 'hof.db'}")
        async with engine.connect() as connection:
            pragmas = [("journal_mode", "wal"), ("synchronous", 2), ("busy_timeout", 10_000), ("foreign_keys", 1)]
            for pragma, expected in pragmas:
                assert (await connection.exec_driver_sql(f"PRAGMA {pragma}")).scalar() == expected
        await engine.dispose()

    asyncio.run(scenario())


def test_a_database_of_this_version_is_opened_again(tmp_path: Path) -> None:
    async def scenario() -> None:
        engines = [await connect(f"sqlite:///{tmp_path / 'hof.db'}") for _ in range(2)]
        for engine in engines:
            await engine.dispose()

    asyncio.run(scenario())
    other = sqlite3.connect(tmp_path / "hof.db")
    names = {name for (name,) in other.execute("SELECT name FROM sqlite_master WHERE name NOT LIKE 'sqlite%'")}
    other.close()
    assert names == {"objects", "uses", "uses_member_id"}


@pytest.mark.parametrize(
    "table",
    [
        "objects (seq INTEGER PRIMARY KEY, id TEXT, kind TEXT, created_at TEXT, model TEXT, spec TEXT, theta BLOB)",
        "uses (composed_id TEXT, member_id TEXT, since TEXT)",
    ],
)
def test_a_database_of_another_version_is_refused_and_left_alone(tmp_path: Path, table: str) -> None:
    with sqlite3.connect(tmp_path / "hof.db") as other:
        other.execute(f"CREATE TABLE {table}")

    with pytest.raises(
        UnusableStore, match=r"hof\.db: its table '\w+' was made by another version .* (members|since)\)"
    ):
        asyncio.run(connect(f"sqlite:///{tmp_path / 'hof.db'}"))
    tables = other.execute("SELECT count(*) FROM sqlite_master WHERE type = 'table'").fetchone()
    other.close()
    assert tables == (1,)
