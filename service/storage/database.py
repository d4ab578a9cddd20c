"""The database: tables and opening. SQLite by default, PostgreSQL by URL."""

from dataclasses import dataclass
from functools import partial
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
    make_url,
)
from sqlalchemy.engine import URL
from sqlalchemy.exc import ArgumentError

from service.errors import UnusableStore
from service.settings import DATABASE_CONNECTIONS, DATABASE_TIMEOUT_S
from service.storage import faults
from service.storage.postgres import check_may_create, open_postgres
from service.storage.postgres_url import PostgresUrl, parse_postgres
from service.storage.schema import Schema, migrate, read_schema
from service.storage.sqlite import SqliteDatabase, check_file, expand, open_sqlite
from service.storage.transactions import Database

MIGRATION_TIMEOUT_S: Final = 600.0  # another process may be migrating; PostgreSQL only

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
    # NULL for a composed object: its word is in `members`. 2 bytes a number if float16 holds all exactly, else 4.
    Column("theta", LargeBinary),
    Column("color", LargeBinary, nullable=True),  # NULL without color, and for a composed object
    Column("color_spec", Text, nullable=True),  # NULL without color
    Column("frame", LargeBinary, nullable=True),  # NULL until an object of an older version is first read
    Column("image", Text, nullable=True),  # NULL without a photo, or if an older version read it
    Column("estimates", Text, nullable=True),  # NULL without a photo, or if its model makes none
    Column("label", Text, nullable=True),  # NULL without a label
    Column("photo", LargeBinary, nullable=True),  # a thumbnail; NULL unless a client asked to keep one
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


@dataclass(frozen=True)
class Address:
    """Address of a database.

    Attributes
    ----------
    shown : the URL as messages may show it, without its password.
    file : the path of a SQLite file; None for another database.
    """

    target: URL | PostgresUrl
    shown: str
    file: Path | None = None

    @property
    def secrets(self) -> tuple[str, ...]:
        """Texts that no message may contain."""
        return self.target.secrets if isinstance(self.target, PostgresUrl) else ()


def parse(url: str) -> Address:
    """Read the URL of a database: `sqlite:///PATH`, `postgresql://...` or `postgres://...`.

    Raises
    ------
    UnusableStore : it is no such URL, its database is in memory, or its file is in the home folder of a user without
        one. The message never shows a password.
    """
    text = url.strip()
    scheme = text.partition("://")[0].partition("+")[0].lower()
    if scheme in ("postgres", "postgresql"):
        target = parse_postgres(text)
        return Address(target, target.shown)
    if scheme == "sqlite":
        try:
            parsed = make_url(text)
        except ArgumentError:
            pass
        else:
            name = parsed.database or ""
            is_memory = name in ("", ":memory:", "file::memory:") or parsed.query.get("mode") == "memory"
            if is_memory:
                raise UnusableStore(
                    f"{parsed.render_as_string()} is a database in memory, which each connection would have to itself; "
                    "name a file: sqlite:///PATH"
                )
            is_path = not name.startswith("file:")
            return Address(parsed, parsed.render_as_string(), expand(name) if is_path else None)
    raise UnusableStore("invalid database URL; expected sqlite:///PATH or postgresql://USER:PASSWORD@HOST/NAME")


async def connect(url: str, timeout_s: float = DATABASE_TIMEOUT_S, connections: int = DATABASE_CONNECTIONS) -> Database:
    """Open a database (`parse`); create a missing file and tables, migrate older tables.

    Parameters
    ----------
    timeout_s : longest time of a transaction of PostgreSQL, with the wait for a connection.
    connections : most connections to PostgreSQL.

    Raises
    ------
    UnusableStore : the URL is invalid, its driver is missing, the database refuses, or a newer version of hof wrote it.
        The message says what to do.
    UnreachableStore : the database does not answer, or is busy, at present.
    """
    address = parse(url)
    try:
        database = _open(address, timeout_s, connections)
        try:
            await database.run(partial(migrate, tables=METADATA), timeout_s=MIGRATION_TIMEOUT_S)
            if isinstance(database, SqliteDatabase):
                await database.watch_files()
        except BaseException:
            await database.close()
            raise
    except Exception as error:  # each driver has its own classes
        raise faults.unusable(address.shown, address.secrets, error) from error
    return database


async def verify(url: str, timeout_s: float = DATABASE_TIMEOUT_S) -> None:
    """Open a database as `connect` does, test that it can be written, read all of a SQLite file, and close it.

    Raises
    ------
    UnusableStore : the database cannot be opened, written or read; the message says what to do.
    """
    database = await connect(url, timeout_s, connections=1)
    try:
        await database.run(_try_write)
        if database.dialect == "sqlite":
            await database.run(check_file)
    except Exception as error:
        address = parse(url)
        raise faults.unusable(address.shown, address.secrets, error) from error
    finally:
        await database.close()


async def examine(url: str, timeout_s: float = DATABASE_TIMEOUT_S) -> Schema:
    """Test an existing database as `verify` does, but create and migrate nothing. Return its schema.

    SQLite itself may complete a transaction that a killed process left in the write-ahead log.

    Raises
    ------
    UnusableStore : `verify` would raise it.
    """
    address = parse(url)
    try:
        database = _open(address, timeout_s, connections=1, unchanged=True)
        try:
            schema = await database.run(read_schema)
            await database.run(database.ping if schema.is_empty else _try_write)
            if database.dialect == "sqlite":
                await database.run(check_file)
            elif schema.is_empty:
                await database.run(check_may_create)
        finally:
            await database.close()
    except Exception as error:
        raise faults.unusable(address.shown, address.secrets, error) from error
    return schema


def _open(address: Address, timeout_s: float, connections: int, *, unchanged: bool = False) -> Database:
    """Return the database at an address; `unchanged` leaves a SQLite file as it is."""
    if isinstance(address.target, PostgresUrl):
        return open_postgres(address.target, timeout_s, connections)
    return open_sqlite(address.target, unchanged=unchanged)


def _try_write(connection: Connection) -> None:
    """Delete nothing, which needs a database that can be written."""
    connection.execute(objects.delete().where(objects.c.id == ""))
