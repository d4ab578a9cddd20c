"""Where objects are kept: id <-> theta, its spec and its colour, or the word of a composed object.

SQLAlchemy Core. An object is never changed once written: it is put, read, listed, deleted.
"""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache, partial
from typing import Any, Final, Literal, TypeVar

import numpy as np
from sqlalchemy import Connection, Row, bindparam, select
from sqlalchemy.exc import DBAPIError, IntegrityError
from sqlalchemy.exc import TimeoutError as PoolTimeout

from service.errors import InUse, InvalidParameter, NotFound, Overloaded, StoreFull
from service.mapping.spec import CACHED_SPECS, Array, Color, Functions, MappingSpec, joined
from service.storage.database import Database, Work, connect, is_busy, is_full, objects, uses

R = TypeVar("R")
Kind = Literal["encoded", "imported", "composed", "interpolated"]

MAX_SEQ: Final = 2**63 - 1
MAX_NAMED: Final = 10  # composed objects that a refusal to delete names
ONE: Final = select(objects).where(objects.c.id == bindparam("of"))  # built once: each photo asks for it
HEADER: Final = [column for column in objects.columns if column.name not in ("theta", "color")]


@dataclass(frozen=True)
class Record:
    """All that is kept about an object but its functions.

    id : hexadecimal digest of what it was made from.
    created_at : UTC.
    model : name of the model that its theta comes from.
    members : ids of what it was made from: the word of a composed object, the parents of an interpolated one.
    color_spec : shape of what colours it; None where it has no colour.
    """

    id: str
    kind: Kind
    model: str
    spec: MappingSpec
    created_at: datetime
    members: tuple[str, ...] = ()
    color_spec: MappingSpec | None = None


class Store:
    """The objects of a database; each step of a method is one short transaction.

    Any method raises Overloaded where others keep the database for too long.
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    @classmethod
    async def open(cls, url: str) -> "Store":
        """As `database.connect`. Raises UnusableStore."""
        return cls(await connect(url))

    async def close(self) -> None:
        """Close all connections."""
        await self._database.close()

    async def ping(self) -> None:
        """Ask the database for nothing. Raises Overloaded, or what SQLAlchemy raises when it does not answer."""
        await self._run(lambda connection: connection.execute(select(1)))

    async def put(self, record: Record, functions: Functions | None) -> tuple[Record, bool]:
        """Keep an object under ``record.id`` unless there is one.

        Returns the object that is kept, and whether it is new: of any number of concurrent puts of one
        id, exactly one is told so. What is returned is on disk.

        Parameters
        ----------
        functions : one theta, and the colour that `record.color_spec` describes; None for a composed object, of
            which `record.members` is all.

        Raises
        ------
        NotFound : the word names an object that is not there (any more).
        StoreFull : there is no space for it.
        """
        kept, any_new = await self.put_all([(record, functions)])
        return kept[0], any_new

    async def put_all(self, proposed: Sequence[tuple[Record, Functions | None]]) -> tuple[list[Record], bool]:
        """Keep all of several objects or, where one is refused, none of them.

        Returns the objects that are kept, in their order, and whether any is new. Each is as `put` has it, and
        so are the errors.
        """
        kept: dict[str, Record] = {}
        while True:  # again only where another put or a delete came between
            # In one order, whatever was asked for: two calls for the same words do not wait for each other in turn.
            fresh = sorted((pair for pair in proposed if pair[0].id not in kept), key=lambda pair: pair[0].members)
            try:
                await self._run(partial(_insert_all, pairs=fresh))
            except IntegrityError:
                kept = await self.records([record.id for record, _ in proposed])
                for record, _ in fresh:
                    if record.id not in kept:
                        await self._check_word(record)
            else:
                return [kept.get(record.id, record) for record, _ in proposed], bool(fresh)

    async def find(self, object_id: str) -> tuple[Record, Functions] | None:
        """The object of that id and its functions; of a composed object those of its word, in order. None where
        there is none."""
        return await self._run(partial(_find, object_id=object_id))

    async def get(self, object_id: str) -> tuple[Record, Functions]:
        """As `find`. Raises NotFound."""
        found = await self.find(object_id)
        if found is None:
            raise NotFound("there is no object of this id")
        return found

    async def record(self, object_id: str) -> Record:
        """The object of that id, without its functions. Raises NotFound."""
        found = await self.records([object_id])
        if object_id not in found:
            raise NotFound("there is no object of this id")
        return found[object_id]

    async def records(self, ids: Sequence[str]) -> dict[str, Record]:
        """Those of the objects that are there, by id, without their functions."""
        query = select(*HEADER).where(objects.c.id.in_(ids))
        rows = await self._run(lambda connection: connection.execute(query).all())
        return {row.id: _record(row) for row in rows}

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
        rows = await self._run(lambda connection: connection.execute(query).all())
        more = len(rows) > limit
        return [_record(row) for row in rows[:limit]], _encode_cursor(rows[limit - 1].seq) if more else None

    async def delete(self, object_id: str) -> None:
        """Remove an object.

        Raises
        ------
        NotFound : there is none of that id.
        InUse : words name it; the message names the composed objects, the oldest first.
        StoreFull : even this takes space, and there is none.
        """
        query = objects.delete().where(objects.c.id == object_id)
        while True:  # again only where the last composed object was deleted meanwhile
            try:
                deleted = await self._run(lambda connection: connection.execute(query).rowcount)
            except IntegrityError:
                await self._check_unused(object_id)
            else:
                break
        if not deleted:
            raise NotFound("there is no object of this id")

    async def _run(self, work: Work[R]) -> R:
        """A transaction. Raises Overloaded and StoreFull."""
        try:
            return await self._database.run(work)
        except (DBAPIError, PoolTimeout) as error:
            if is_busy(error):
                raise Overloaded("the store has more work than it can do") from error
            if is_full(error):
                raise StoreFull("the store has no space left; nothing of this call is kept") from error
            raise

    async def _check_word(self, record: Record) -> None:
        there = await self.records(record.members)
        for member in record.members:
            if record.kind == "composed" and member not in there:
                raise NotFound(f"there is no object {member} any more, which the word names")

    async def _check_unused(self, object_id: str) -> None:
        query = select(objects.c.id).join(uses, objects.c.id == uses.c.composed_id).order_by(objects.c.seq)
        query = query.where(uses.c.member_id == object_id)
        found = await self._run(lambda connection: connection.execute(query).scalars().all())
        if found:
            more = f" and {len(found) - MAX_NAMED} more" if len(found) > MAX_NAMED else ""
            raise InUse(f"composed objects are made of it: {', '.join(found[:MAX_NAMED])}{more}; delete them first")


def _find(connection: Connection, object_id: str) -> tuple[Record, Functions] | None:
    """As `Store.find`."""
    row = connection.execute(ONE, {"of": object_id}).first()
    if row is None:
        return None
    record = _record(row)
    if record.kind != "composed":
        return record, _functions(row)
    query = select(objects).where(objects.c.id.in_(record.members))
    found = {each.id: _functions(each) for each in connection.execute(query)}
    if found.keys() != set(record.members):
        return None  # deleted between the two queries, and then an object of its word
    return record, joined([found[member] for member in record.members])


def _insert_all(connection: Connection, pairs: Sequence[tuple[Record, Functions | None]]) -> None:
    for record, functions in pairs:
        _insert(connection, record, functions)


def _insert(connection: Connection, record: Record, functions: Functions | None) -> None:
    color = functions.color if functions else None
    values = {
        "id": record.id,
        "kind": record.kind,
        "created_at": record.created_at,
        "model": record.model,
        "spec": record.spec.to_json(),
        "members": " ".join(record.members),
        "theta": _bytes(functions.theta) if functions else None,
        "color": _bytes(color.weights) if color else None,
        "color_spec": record.color_spec.to_json() if record.color_spec else None,
    }
    connection.execute(objects.insert(), values)
    if record.kind == "composed":
        pairs = [{"composed_id": record.id, "member_id": member} for member in set(record.members)]
        connection.execute(uses.insert(), pairs)


_spec = lru_cache(CACHED_SPECS)(MappingSpec.from_json)


def _record(row: Row[Any]) -> Record:
    created_at = row.created_at.replace(tzinfo=UTC)  # SQLite drops the zone; it was UTC
    spec, members = _spec(row.spec), tuple(row.members.split())
    color_spec = _spec(row.color_spec) if row.color_spec else None
    return Record(row.id, row.kind, row.model, spec, created_at, members, color_spec)


def _functions(row: Row[Any]) -> Functions:
    if row.color is None:
        return Functions(_array(row.theta))
    return Functions(_array(row.theta), Color(_spec(row.color_spec), _array(row.color)))


def _bytes(array: Array) -> bytes:
    return np.ascontiguousarray(array, dtype="<f4").tobytes()


def _array(data: bytes) -> Array:
    return np.frombuffer(data, dtype="<f4").astype(np.float32, copy=False)


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
