"""The store of objects: id -> theta, its spec and its color, or the word of a composed object.

The function of an object never changes once written; its label may.
"""

import asyncio
import logging
import time
from collections.abc import Awaitable, Iterable, Mapping, Sequence
from functools import partial
from typing import Any, Final

from sqlalchemy import Connection, bindparam, func, select
from sqlalchemy.exc import IntegrityError

from service.errors import InUse, NotFound, StoreUnavailable, UnreachableStore
from service.mapping.frame import Frame
from service.mapping.spec import Functions, MappingSpec
from service.settings import DATABASE_CONNECTIONS, DATABASE_TIMEOUT_S
from service.storage.cursors import decode_cursor, encode_cursor
from service.storage.database import connect, objects, uses
from service.storage.faults import domain_error, reason_of, too_busy
from service.storage.rows import (
    ALL,
    HEADER,
    Entry,
    Record,
    entry_of,
    find_whole,
    insert_all,
    next_entries,
    record_of,
)
from service.storage.transactions import Database, R, Work

logger: Final = logging.getLogger("hof")

ATTEMPTS: Final = 10  # of a write that other writes thwart
REOPEN_S: Final = 1.0
MAX_NAMED: Final = 10  # composed objects that a refused deletion lists
HEAD: Final = select(*HEADER).where(objects.c.id == bindparam("of"))  # every call of an object's file


class Store:
    """The objects of a database, read and written in short transactions.

    Every method raises Overloaded if others hold the database for too long, StoreUnavailable if it does not answer.

    answered_at : time of the last answer of the database, `time.monotonic()`.
    max_silence_s : time without an answer after which the database counts as unreachable.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._is_available = True
        self.answered_at = time.monotonic()
        self.max_silence_s: Final = database.max_silence_s

    @classmethod
    async def open(
        cls, url: str, timeout_s: float = DATABASE_TIMEOUT_S, connections: int = DATABASE_CONNECTIONS
    ) -> "Store":
        """Open the store at a database URL (`database.connect`). Raises UnusableStore."""
        return cls(await connect(url, timeout_s, connections))

    @classmethod
    async def open_once_reachable(cls, url: str, timeout_s: float, connections: int) -> "Store":
        """Open a store; wait as long as its database does not answer. Raises UnusableStore."""
        while True:
            try:
                return await cls.open(url, timeout_s, connections)
            except UnreachableStore as error:
                logger.warning("%s; trying again every second", error.detail)
                await asyncio.sleep(REOPEN_S)

    async def close(self) -> None:
        """Close all connections."""
        await self._database.close()

    async def ping(self) -> None:
        """Do the least work that shows that the database can be used. Raises Overloaded and StoreUnavailable."""
        await self._run(self._database.ping)

    async def put(self, record: Record, functions: Functions | None, photo: bytes | None = None) -> tuple[Record, bool]:
        """Store an object under ``record.id`` unless that id exists.

        Returns the stored object and whether it is new; of concurrent puts of one id, exactly one is new. The object
        is on disk when this returns.

        Parameters
        ----------
        functions : one theta, and the color that `record.color_spec` describes; None for a composed object, which
            consists of `record.members`.
        photo : thumbnail of its photo, kept with it and deleted with it.

        Raises
        ------
        NotFound : the word names an object that does not exist.
        StoreFull : the database has no space left.
        """
        kept, any_new = await self.put_all([(record, functions)], {record.id: photo} if photo else {})
        return kept[0], any_new

    async def put_all(
        self, proposed: Sequence[tuple[Record, Functions | None]], photos: Mapping[str, bytes] | None = None
    ) -> tuple[list[Record], bool]:
        """Store several objects, all or none.

        Returns the stored objects, in the order given, and whether any is new. Parameters and errors are those of
        `put`; `photos` are by id.
        """
        kept: dict[str, Record] = {}
        for _ in range(ATTEMPTS):  # repeats only if another put or a delete intervenes, or after a repair
            # Always in the same order, so that two calls for the same words cannot deadlock.
            fresh = sorted((pair for pair in proposed if pair[0].id not in kept), key=lambda pair: pair[0].members)
            try:
                await self._answer_of(self._database.write(partial(insert_all, pairs=fresh, photos=photos or {})))
            except IntegrityError:
                kept = await self.records([record.id for record, _ in proposed])
                for record, _ in fresh:
                    if record.id not in kept:
                        await self._check_word(record)
                        await self._run(_remove_orphans)
            else:
                return [kept.get(record.id, record) for record, _ in proposed], bool(fresh)
        raise too_busy()

    async def find(self, object_id: str) -> tuple[Record, Functions] | None:
        """Return an object and its functions (for a composed object, those of its word, in order), or None."""
        return await self._run(partial(find_whole, object_id=object_id))

    async def get(self, object_id: str) -> tuple[Record, Functions]:
        """Return an object and its functions (`find`). Raises NotFound."""
        if match := await self.find(object_id):
            return match
        raise NotFound(f"no object has the id {object_id}")

    async def record(self, object_id: str) -> Record:
        """Return an object without its functions. Raises NotFound."""
        if record := await self.find_record(object_id):
            return record
        raise NotFound(f"no object has the id {object_id}")

    async def find_record(self, object_id: str) -> Record | None:
        """Return an object without its functions, or None."""
        query = self._database.look_up(lambda connection: connection.execute(HEAD, {"of": object_id}).first())
        row = await self._answer_of(query)
        return None if row is None else record_of(row)

    async def complete(self, object_id: str, frame: Frame, missing: Mapping[str, Any]) -> Record:
        """Keep what an object lacks: its frame, and details (`Details.missing_in`). Return the record.

        Of concurrent calls the first one counts. Raises NotFound and StoreFull.
        """
        values = {
            name: func.coalesce(objects.c[name], value)
            for name, value in {**missing, "frame": frame.to_bytes()}.items()
        }
        query = objects.update().where(objects.c.id == object_id).values(values)
        await self._run(lambda connection: connection.execute(query))
        return await self.record(object_id)

    async def relabel(self, object_id: str, label: str | None) -> Record:
        """Give an object another label, or none. Return the record. Raises NotFound and StoreFull."""
        query = objects.update().where(objects.c.id == object_id).values(label=label)
        await self._run(lambda connection: connection.execute(query))
        return await self.record(object_id)

    async def photo(self, object_id: str) -> bytes | None:
        """Return the thumbnail of an object's photo; None if there is no such object, or if it has none."""
        query = select(objects.c.photo).where(objects.c.id == object_id)
        photo: bytes | None = await self._run(lambda connection: connection.execute(query).scalar())
        return photo

    async def records(self, ids: Sequence[str]) -> dict[str, Record]:
        """Return the objects that exist among `ids`, by id, without their functions."""
        query = select(*HEADER).where(objects.c.id.in_(ids))
        rows = await self._run(lambda connection: connection.execute(query).all())
        return {row.id: record_of(row) for row in rows}

    async def page(self, limit: int, cursor: str | None = None) -> tuple[list[Record], str | None]:
        """Return up to `limit` objects from the cursor on, newest first, and the cursor of the next page (None: last).

        New objects do not shift the pages: a walk over all pages meets each older object once.

        Raises
        ------
        InvalidParameter : the cursor did not come from a page.
        """
        query = select(*HEADER).order_by(objects.c.seq.desc()).limit(limit + 1)
        if cursor is not None:
            query = query.where(objects.c.seq < decode_cursor(cursor))
        rows = await self._run(lambda connection: connection.execute(query).all())
        more = len(rows) > limit
        return [record_of(row) for row in rows[:limit]], encode_cursor(rows[limit - 1].seq) if more else None

    async def count(self) -> int:
        """Return the number of objects."""
        query = select(func.count()).select_from(objects)
        return await self._run(lambda connection: connection.execute(query).scalar_one())

    async def last_seq(self) -> int:
        """Return the `seq` of the newest object; 0 without objects."""
        query = select(func.coalesce(func.max(objects.c.seq), 0))
        return await self._run(lambda connection: connection.execute(query).scalar_one())

    async def specs(self, last: int) -> tuple[set[MappingSpec], set[MappingSpec]]:
        """Return the specs of the objects up to a `seq` that have a theta, and those of their colors."""
        kept = objects.c.seq <= last, objects.c.kind != "composed"
        spec, color = (select(column).where(*kept).distinct() for column in (objects.c.spec, objects.c.color_spec))
        texts = await self._run(lambda connection: connection.execute(spec).scalars().all())
        colors = await self._run(lambda connection: connection.execute(color).scalars().all())
        return {MappingSpec.from_json(text) for text in texts}, {MappingSpec.from_json(text) for text in colors if text}

    async def entries(self, after: int, last: int) -> list[Entry]:
        """Return the next objects whose `seq` is above `after`, up to `last`, oldest first; at most `BATCH_ROWS`.

        Their functions and photos have at most `BATCH_BYTES`, or there is only one object.
        """
        return await self._run(partial(next_entries, after=after, last=last))

    async def entries_of(self, ids: Iterable[str]) -> list[Entry]:
        """Return the objects that exist among `ids`, oldest first."""
        query = select(*ALL).where(objects.c.id.in_(list(ids))).order_by(objects.c.seq)
        return await self._run(lambda connection: [entry_of(row) for row in connection.execute(query)])

    async def delete(self, object_id: str) -> None:
        """Delete an object.

        Raises
        ------
        NotFound : no object has this id.
        InUse : composed objects use it; the message lists them, oldest first.
        StoreFull : deleting needs space too, and none is left.
        """
        query = objects.delete().where(objects.c.id == object_id)
        for _ in range(ATTEMPTS):  # repeats only if the last user was deleted meanwhile, or after a repair
            try:
                deleted = await self._run(lambda connection: connection.execute(query).rowcount)
            except IntegrityError:
                await self._check_unused(object_id)
                await self._run(_remove_orphans)
            else:
                if not deleted:
                    raise NotFound(f"no object has the id {object_id}")
                return
        raise too_busy()

    async def _run(self, work: Work[R]) -> R:
        """Run a transaction. Raises as `_answer_of` does."""
        return await self._answer_of(self._database.run(work))

    async def _answer_of(self, transaction: Awaitable[R]) -> R:
        """Await a transaction. Raises Overloaded, StoreFull, StoreUnavailable, and IntegrityError as it is."""
        try:
            result = await transaction
        except Exception as error:  # each driver has its own classes
            fault = domain_error(error)
            if isinstance(fault, StoreUnavailable) and self._is_available:  # once, not for each call
                self._is_available = False
                logger.warning("the database cannot be used: %s", reason_of(error))
            if fault is error:
                raise
            raise fault from error
        self.answered_at = time.monotonic()
        if not self._is_available:
            self._is_available = True
            logger.info("the database can be used again")
        return result

    async def _check_word(self, record: Record) -> None:
        existing = await self.records(record.members)
        for member in record.members:
            if record.kind == "composed" and member not in existing:
                raise NotFound(f"the word names the object {member}, which no longer exists")

    async def _check_unused(self, object_id: str) -> None:
        query = select(objects.c.id).join(uses, objects.c.id == uses.c.composed_id).order_by(objects.c.seq)
        query = query.where(uses.c.member_id == object_id)
        users = await self._run(lambda connection: connection.execute(query).scalars().all())
        if users:
            more = f" and {len(users) - MAX_NAMED} more" if len(users) > MAX_NAMED else ""
            raise InUse(f"composed objects use it: {', '.join(users[:MAX_NAMED])}{more}; delete them first")


def _remove_orphans(connection: Connection) -> None:
    """Remove the uses by objects that do not exist, which programs leave that do not check foreign keys."""
    connection.execute(uses.delete().where(uses.c.composed_id.not_in(select(objects.c.id))))
