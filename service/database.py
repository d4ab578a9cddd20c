"""The database of objects: its tables, and how it is opened. SQLite by default, PostgreSQL by URL."""

from pathlib import Path
from typing import Final

from sqlalchemy import (
    BigInteger,
    Column,
    Connection,
    DateTime,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    Text,
    event,
    inspect,
    make_url,
)
from sqlalchemy.engine import URL
from sqlalchemy.engine.interfaces import DBAPIConnection
from sqlalchemy.exc import ArgumentError
from sqlalchemy.ext.asyncio import AsyncEngine, create_async_engine
from sqlalchemy.schema import CreateIndex, CreateTable

from service.errors import UnusableStore

ASYNC_DRIVERS: Final = {"sqlite": "sqlite+aiosqlite", "postgresql": "postgresql+asyncpg"}
BUSY_TIMEOUT_MS: Final = 10_000

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


async def connect(url: str) -> AsyncEngine:
    """Open `sqlite:///PATH` or `postgresql://...`; make the file and the tables where missing.

    Raises
    ------
    UnusableStore : the URL is none, its driver is missing, the database does not answer or refuses, or its
        tables are of another version.
    """
    try:
        parsed = make_url(url)
    except ArgumentError as error:
        raise UnusableStore("the database URL is none: sqlite:///PATH or postgresql://... is expected") from error
    try:
        return await _engine_with_tables(parsed)
    except Exception as error:  # each driver has classes of its own
        shown = parsed.render_as_string(hide_password=True)
        raise UnusableStore(f"cannot open the database {shown}: {_first_line(error)}") from error


async def _engine_with_tables(url: URL) -> AsyncEngine:
    engine = _engine(url.set(drivername=ASYNC_DRIVERS.get(url.drivername, url.drivername)))
    try:
        async with engine.begin() as connection:
            await connection.run_sync(_check_tables)
            for table in METADATA.sorted_tables:
                await connection.execute(CreateTable(table, if_not_exists=True))
                for index in table.indexes:
                    await connection.execute(CreateIndex(index, if_not_exists=True))
    except BaseException:
        await engine.dispose()
        raise
    return engine


def _check_tables(connection: Connection) -> None:
    """Refuse tables of other columns, before anything is written."""
    inspector = inspect(connection)
    for table in METADATA.sorted_tables:
        if inspector.has_table(table.name):
            found = {column["name"] for column in inspector.get_columns(table.name)}
            wrong = sorted(found ^ set(table.columns.keys()))
            if wrong:
                raise UnusableStore(
                    f"its table {table.name!r} was made by another version of hof (it differs in {', '.join(wrong)}); "
                    "name another database, or start the version that made it"
                )


def _first_line(error: Exception) -> str:
    """What a driver says, without the pages that SQLAlchemy adds."""
    cause = getattr(error, "orig", None) or error
    return next(iter(str(cause).splitlines()), type(cause).__name__)


def _engine(url: URL) -> AsyncEngine:
    if url.get_backend_name() != "sqlite":
        return create_async_engine(url, pool_pre_ping=True)
    if url.database:
        Path(url.database).parent.mkdir(parents=True, exist_ok=True)
    engine = create_async_engine(url)
    event.listen(engine.sync_engine, "connect", _configure_sqlite)
    return engine


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
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()
