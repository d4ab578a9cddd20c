"""Where objects are kept: id <-> theta and its spec. SQLite by default, PostgreSQL by URL.

One table, SQLAlchemy Core. An object is never changed once written: it is put, read, listed, deleted.
"""

import base64
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from sqlalchemy import (
    BigInteger,
    Column,
    DateTime,
    Integer,
    LargeBinary,
    MetaData,
    Row,
    String,
    Table,
    Text,
    event,
    make_url,
    select,
)
from sqlalchemy.engine import URL
from sqlalchemy.engine.interfaces import DBAPIConnection
from sqlalchemy.exc import ArgumentError, IntegrityError
from sqlalchemy.ext.asyncio import AsyncEngine, create_async_engine
from sqlalchemy.schema import CreateTable

from service.errors import InvalidParameter, NotFound, UnusableStore
from service.mapping import Array, MappingSpec

Kind = Literal["encoded", "imported"]

ASYNC_DRIVERS: Final = {"sqlite": "sqlite+aiosqlite", "postgresql": "postgresql+asyncpg"}
BUSY_TIMEOUT_MS: Final = 10_000
MAX_SEQ: Final = 2**63 - 1

objects: Final = Table(
    "objects",
    MetaData(),
    # seq orders the list: the clock may stand still between two objects, or step back.
    Column("seq", BigInteger().with_variant(Integer, "sqlite"), primary_key=True, autoincrement=True),
    Column("id", String(64), nullable=False, unique=True),
    Column("kind", String(16), nullable=False),
    Column("created_at", DateTime(timezone=True), nullable=False),
    Column("model", Text, nullable=False),
    Column("spec", Text, nullable=False),
    Column("theta", LargeBinary, nullable=False),
    sqlite_autoincrement=True,  # never reuses the seq of a deleted object: cursors stay true
)
HEADER: Final = [column for column in objects.columns if column.name != "theta"]


@dataclass(frozen=True)
class Record:
    """All that is kept about an object but its theta.

    id : hexadecimal digest of what it was made from.
    created_at : UTC.
    model : name of the model that its theta comes from.
    """

    id: str
    kind: Kind
    model: str
    spec: MappingSpec
    created_at: datetime


class Store:
    """The table of objects behind one connection pool; every method is one short transaction."""

    def __init__(self, engine: AsyncEngine) -> None:
        self._engine = engine

    @classmethod
    async def open(cls, url: str) -> "Store":
        """Connect to `sqlite:///PATH` or `postgresql://...`; make the file and the table where missing.

        Raises
        ------
        UnusableStore : the URL is none, its driver is missing, or the database does not answer or refuses.
        """
        try:
            parsed = make_url(url)
        except ArgumentError as error:
            raise UnusableStore("the database URL is none: sqlite:///PATH or postgresql://... is expected") from error
        try:
            return cls(await _engine_with_table(parsed))
        except Exception as error:  # each driver has classes of its own
            shown = parsed.render_as_string(hide_password=True)
            raise UnusableStore(f"cannot open the database {shown}: {_first_line(error)}") from error

    async def close(self) -> None:
        """Close all connections."""
        await self._engine.dispose()

    async def ping(self) -> None:
        """Ask the database for nothing. Raises what SQLAlchemy raises when it does not answer."""
        async with self._engine.connect() as connection:
            await connection.execute(select(1))

    async def put(self, record: Record, theta: Array) -> tuple[Record, bool]:
        """Keep an object under ``record.id`` unless there is one.

        Returns the object that is kept, and whether it is new: of any number of concurrent puts of one
        id, exactly one is told so. What is returned is on disk.
        """
        values = {
            "id": record.id,
            "kind": record.kind,
            "created_at": record.created_at,
            "model": record.model,
            "spec": record.spec.to_json(),
            "theta": np.ascontiguousarray(theta, dtype="<f4").tobytes(),
        }
        try:
            async with self._engine.begin() as connection:
                await connection.execute(objects.insert().values(values))
        except IntegrityError:
            found = await self.find(record.id)
            # Where a delete came between, the object was kept and is gone: the answer is still right.
            return (found[0] if found else record), False
        return record, True

    async def find(self, object_id: str) -> tuple[Record, Array] | None:
        """The object of that id and its theta, (spec.size,) float32; None where there is none."""
        async with self._engine.connect() as connection:
            row = (await connection.execute(select(objects).where(objects.c.id == object_id))).first()
        if row is None:
            return None
        return _record(row), np.frombuffer(row.theta, dtype="<f4").astype(np.float32, copy=False)

    async def get(self, object_id: str) -> tuple[Record, Array]:
        """As `find`. Raises NotFound."""
        found = await self.find(object_id)
        if found is None:
            raise NotFound("there is no object of this id")
        return found

    async def page(self, limit: int, cursor: str | None = None) -> tuple[list[Record], str | None]:
        """Up to `limit` objects, newest first, from the cursor on; and the cursor of the next page.

        Objects that come in between pages shift nothing: a walk meets each older object once.

        Raises
        ------
        InvalidParameter : a cursor that no page gave.
        """
        query = select(*HEADER).order_by(objects.c.seq.desc()).limit(limit + 1)
        if cursor is not None:
            query = query.where(objects.c.seq < _decode_cursor(cursor))
        async with self._engine.connect() as connection:
            rows = (await connection.execute(query)).all()
        more = len(rows) > limit
        return [_record(row) for row in rows[:limit]], _encode_cursor(rows[limit - 1].seq) if more else None

    async def delete(self, object_id: str) -> None:
        """Remove an object. Raises NotFound."""
        async with self._engine.begin() as connection:
            result = await connection.execute(objects.delete().where(objects.c.id == object_id))
        if result.rowcount == 0:
            raise NotFound("there is no object of this id")


async def _engine_with_table(url: URL) -> AsyncEngine:
    engine = _engine(url.set(drivername=ASYNC_DRIVERS.get(url.drivername, url.drivername)))
    try:
        async with engine.begin() as connection:
            await connection.execute(CreateTable(objects, if_not_exists=True))
    except BaseException:
        await engine.dispose()
        raise
    return engine


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
    for pragma in (f"busy_timeout = {BUSY_TIMEOUT_MS}", "journal_mode = WAL", "synchronous = FULL"):
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()


def _record(row: Row[Any]) -> Record:
    created_at = row.created_at.replace(tzinfo=UTC)  # SQLite drops the zone; it was UTC
    return Record(row.id, row.kind, row.model, MappingSpec.from_json(row.spec), created_at)


def _encode_cursor(seq: int) -> str:
    return base64.urlsafe_b64encode(str(seq).encode()).decode().rstrip("=")


def _decode_cursor(cursor: str) -> int:
    try:
        text = base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4))
        seq = int(text)
    except ValueError as error:
        raise InvalidParameter("this is no cursor of a page of objects", field="cursor") from error
    if not 1 <= seq <= MAX_SEQ or _encode_cursor(seq) != cursor:
        raise InvalidParameter("this is no cursor of a page of objects", field="cursor")
    return seq
