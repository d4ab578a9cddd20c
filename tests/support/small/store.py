"""Records, an open store, and objects of every kind to fill it with."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta

from service.encoding.estimates import Camera, Estimates
from service.encoding.report import ImageReport
from service.mapping.frame import Frame
from service.mapping.spec import Color, Functions, MappingSpec, initial_theta
from service.storage.ids import composed_id, imported_id, interpolated_id
from service.storage.rows import Record
from service.storage.store import Store
from service.storage.transfer.content import digest_of

SPEC = MappingSpec("tiny", 3, (4,), 3, k=2)
NOW = datetime(2026, 1, 2, 3, 4, 5, 678901, UTC)
THETA = initial_theta(SPEC)
WIDE = MappingSpec("wide", 3, (7,), 3, k=2)
COLOR = MappingSpec("color", 3, (5,), 3)
PHOTO = b"RIFF\x0c\x00\x00\x00WEBPVP8 "


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


async def fill(store: Store, encoded: int = 3) -> list[str]:
    """Put encoded, imported, interpolated and composed objects; return all ids, oldest first."""
    pairs = [pair_of(number) for number in range(encoded)]
    wide = initial_theta(WIDE, 99)
    wide_id = imported_id(WIDE, Functions(wide))
    pairs.append((replace(encoded_record(wide_id, WIDE), kind="imported"), Functions(wide)))
    parents = pairs[0][0].id, pairs[1][0].id
    mean = Record(interpolated_id(parents), "interpolated", "tiny-k2", SPEC, NOW, parents)
    pairs.append((mean, Functions(initial_theta(SPEC, 98))))
    for record, functions in pairs:
        await store.put(record, functions, PHOTO if record.has_photo else None)
    word = (mean.id, pairs[0][0].id)
    composed = Record(composed_id(word), "composed", "tiny-k2", SPEC, NOW, word, color_spec=COLOR)
    await store.put(composed, None)
    return [*(record.id for record, _ in pairs), composed.id]


def pair_of(number: int) -> tuple[Record, Functions]:
    """Return an encoded object with all that a record may hold."""
    theta = initial_theta(SPEC, number)
    record = Record(
        f"{number:032x}",
        "encoded",
        "tiny-k2",
        SPEC,
        NOW + timedelta(seconds=number),
        color_spec=COLOR,
        frame=Frame((-0.5, -0.25, -0.125), (0.5, 0.25, 0.125)),
        image=ImageReport("border", (1, 2, 3, 4), None if number else 0.987, 120, 90),
        estimates=Estimates(0.75, Camera(1.5, -2.5, 3.25, 0.5)),
        label=f"chair {number}" if number else None,
        has_photo=number == 1,
    )
    return record, Functions(theta, Color(COLOR, initial_theta(COLOR, number)))


async def digests(store: Store) -> dict[str, str]:
    """Return the digest of each object's content, by id."""
    entries = await store.entries(0, await store.last_seq())
    return {entry.record.id: digest_of(entry.record, entry.functions) for entry in entries}
