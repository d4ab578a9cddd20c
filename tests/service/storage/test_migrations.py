"""Migrations: from the first release, from an empty database, several at once, and refusals."""

import asyncio
import sqlite3
from pathlib import Path

import numpy as np
import pytest
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy import Connection, make_url

from service.errors import UnusableStore
from service.mapping.spec import MappingSpec, initial_theta
from service.storage.database import METADATA, connect
from tests.support.small.store import open_store
from tests.support.systems.postgres import EVERY_DATABASE, Postgres

pytestmark = EVERY_DATABASE

DATA = Path(__file__).parent / "schemas"
HEAD = "0006"
SPEC = MappingSpec("tiny", 3, (2,), 3, k=2)


def _run(sql: str, url: str, request: pytest.FixtureRequest) -> str:
    """Run SQL with another program than the service, and return its output."""
    parsed = make_url(url)
    assert parsed.database
    if parsed.drivername == "postgresql":
        postgres: Postgres = request.getfixturevalue("postgres")
        return postgres.run(sql, parsed.database)
    Path(parsed.database).parent.mkdir(exist_ok=True)
    connection = sqlite3.connect(parsed.database)
    try:
        if sql.startswith("SELECT"):
            return "\n".join(str(value) for (value,) in connection.execute(sql))
        connection.executescript(sql)
        connection.commit()
    finally:
        connection.close()
    return ""


def _revision(url: str, request: pytest.FixtureRequest) -> str:
    return _run("SELECT version_num FROM alembic_version", url, request)


def _differences(connection: Connection) -> list[object]:
    return list(compare_metadata(MigrationContext.configure(connection, opts={"compare_type": True}), METADATA))


async def _opened(url: str) -> list[object]:
    """Open and close a database; return how its tables differ from those that the code declares."""
    database = await connect(url)
    differences = await database.run(_differences)
    await database.close()
    return differences


def _first_release(url: str, request: pytest.FixtureRequest) -> None:
    _run((DATA / f"first-schema.{make_url(url).drivername}.sql").read_text("utf-8"), url, request)


def test_connect_to_an_empty_database_creates_the_declared_tables(
    database_url: str, request: pytest.FixtureRequest
) -> None:
    assert asyncio.run(_opened(database_url)) == []
    assert _revision(database_url, request) == HEAD
    assert asyncio.run(_opened(database_url)) == []


def test_connect_to_a_first_release_database_migrates_it_and_keeps_its_objects(
    database_url: str, request: pytest.FixtureRequest
) -> None:
    _first_release(database_url, request)
    assert asyncio.run(_opened(database_url)) == []
    assert _revision(database_url, request) == HEAD

    async def scenario() -> None:
        async with open_store(database_url) as store:
            records, _ = await store.page(9)
            assert [record.kind for record in records] == ["interpolated", "composed", "imported", "imported"]
            word = [initial_theta(SPEC, seed) for seed in (1, 2)]
            np.testing.assert_array_equal((await store.get(records[1].id))[1].theta, word)
            np.testing.assert_allclose((await store.get(records[0].id))[1].theta, np.mean(word, axis=0), rtol=1e-6)
            assert records[1].members == (records[3].id, records[2].id)

    asyncio.run(scenario())


def test_connect_of_several_at_once_migrates_once(database_url: str, request: pytest.FixtureRequest) -> None:
    _first_release(database_url, request)

    async def scenario() -> None:
        assert await asyncio.gather(*[_opened(database_url) for _ in range(5)]) == [[]] * 5

    asyncio.run(scenario())
    assert _revision(database_url, request) == HEAD


def test_connect_to_a_newer_database_names_a_remedy(database_url: str, request: pytest.FixtureRequest) -> None:
    asyncio.run(_opened(database_url))
    _run("UPDATE alembic_version SET version_num = '9999'", database_url, request)
    with pytest.raises(UnusableStore, match=rf"revision 9999, newer than {HEAD}, .*; start the version of hof"):
        asyncio.run(connect(database_url))
    assert _revision(database_url, request) == "9999"


@pytest.mark.parametrize(
    "table",
    [
        "objects (seq INTEGER PRIMARY KEY, id TEXT, kind TEXT, created_at TEXT, model TEXT, spec TEXT, theta TEXT)",
        "uses (composed_id TEXT, member_id TEXT, since TEXT)",
        "uses (composed_id TEXT, member_id TEXT)",
    ],
)
def test_connect_to_tables_of_another_program_is_refused_and_changes_nothing(
    database_url: str, request: pytest.FixtureRequest, table: str
) -> None:
    _run(f"CREATE TABLE {table}", database_url, request)
    with pytest.raises(UnusableStore, match=r"its table '\w+' does not belong to hof .* name another database"):
        asyncio.run(connect(database_url))
    catalogue = "sqlite_master WHERE type = 'table'"
    if database_url.startswith("postgresql"):
        catalogue = "pg_tables WHERE schemaname = 'public'"
    assert _run(f"SELECT count(*) FROM {catalogue}", database_url, request) == "1"
