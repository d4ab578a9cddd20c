"""A record and an open store, for tests of the store."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from datetime import UTC, datetime

from service.mapping.spec import MappingSpec, initial_theta
from service.storage.rows import Record
from service.storage.store import Store

SPEC = MappingSpec("tiny", 3, (4,), 3, k=2)
NOW = datetime(2026, 1, 2, 3, 4, 5, 678901, UTC)
THETA = initial_theta(SPEC)


def encoded_record(name: str, spec: MappingSpec = SPEC) -> Record:
    """Return the record of an encoded object with the id `name`."""
    return Record(name, "encoded", "tiny-k2", spec, NOW)


@asynccontextmanager
async def open_store(url: str) -> AsyncIterator[Store]:
    """Open a store until the block ends."""
    store = await Store.open(url)
    try:
        yield store
    finally:
        await store.close()
