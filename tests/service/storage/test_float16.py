"""Functions in float16: half the bytes in the database, the same numbers for everyone who reads them."""

import asyncio
from dataclasses import replace
from pathlib import Path

import numpy as np
from sqlalchemy import func, select

from service.formats.rounding import rounded
from service.mapping.spec import Color, Functions, initial_theta
from service.storage.database import objects
from service.storage.ids import composed_id
from service.storage.rows import Record
from service.storage.store import Store
from service.storage.transfer.content import Tally
from service.storage.transfer.copying import copy
from service.storage.transfer.parquet import export, import_file
from tests.support.small.store import COLOR, NOW, SPEC, digests, open_store, pair_of
from tests.support.systems.postgres import EVERY_DATABASE

IDS = ["0" * 31 + "1", "0" * 31 + "2"]


def _halves(number: int) -> tuple[Record, Functions]:
    record, functions = pair_of(number)
    kept = rounded(SPEC, functions, "float16")
    assert kept is not functions
    return record, kept


async def _sizes(store: Store) -> dict[str, tuple[int, int]]:
    """Return the bytes of each object's theta and color."""
    query = select(objects.c.id, func.length(objects.c.theta), func.length(objects.c.color))
    rows = await store._run(lambda connection: connection.execute(query).all())
    return {name: (theta, color) for name, theta, color in rows}


async def _fill(store: Store) -> list[str]:
    """Put an object in float16, one in float32, and the word of both."""
    await store.put(*_halves(1))
    await store.put(*pair_of(2))
    word = (IDS[0], IDS[1])
    await store.put(Record(composed_id(word), "composed", "m", SPEC, NOW, word, color_spec=COLOR), None)
    return [*IDS, composed_id(word)]


@EVERY_DATABASE
def test_store_with_float16_numbers_keeps_half_the_bytes_and_every_number(database_url: str) -> None:
    async def scenario() -> None:
        async with open_store(database_url) as store:
            ids = await _fill(store)
            sizes = await _sizes(store)
            assert sizes[ids[0]] == (2 * SPEC.size, 2 * COLOR.size)
            assert sizes[ids[1]] == (4 * SPEC.size, 4 * COLOR.size)
            _, half = await store.get(ids[0])
            _, whole = await store.get(ids[1])
            _, word = await store.get(ids[2])
            assert half.theta.dtype == np.float32
            np.testing.assert_array_equal(half.theta, _halves(1)[1].theta)
            np.testing.assert_array_equal(whole.theta, pair_of(2)[1].theta)
            np.testing.assert_array_equal(word.theta, np.stack([half.theta, whole.theta]))
            assert half.color
            assert word.color
            np.testing.assert_array_equal(word.color.weights[0], half.color.weights)

    asyncio.run(scenario())


def test_store_with_numbers_that_float16_does_not_hold_exactly_keeps_all_bytes(tmp_path: Path) -> None:
    record, functions = _halves(1)
    theta = functions.theta.copy()
    theta[3] = np.nextafter(theta[3], np.float32(2))
    large = np.float32(1e6) * np.ones(COLOR.size, np.float32)

    async def scenario() -> None:
        async with open_store(f"sqlite:///{tmp_path / 'a.db'}") as store:
            await store.put(record, replace(functions, theta=theta, color=Color(COLOR, large)))
            assert await _sizes(store) == {record.id: (4 * SPEC.size, 4 * COLOR.size)}
            np.testing.assert_array_equal((await store.get(record.id))[1].theta, theta)

    asyncio.run(scenario())


@EVERY_DATABASE
def test_copy_and_parquet_with_float16_keep_digests_and_bytes(database_url: str, tmp_path: Path) -> None:
    async def scenario() -> None:
        async with open_store(f"sqlite:///{tmp_path / 'a.db'}") as a, open_store(database_url) as b:
            await _fill(a)
            assert await copy(a, b, lambda *_: None) == Tally(copied=3)
            assert await export(b, tmp_path / "objects.parquet", lambda *_: None) == 3
            async with open_store(f"sqlite:///{tmp_path / 'c.db'}") as c:
                assert await import_file(c, tmp_path / "objects.parquet", lambda *_: None) == Tally(copied=3)
                assert await digests(a) == await digests(b) == await digests(c)
                assert await _sizes(a) == await _sizes(b) == await _sizes(c)

    asyncio.run(scenario())


def test_copy_onto_the_float32_numbers_of_an_object_tells_that_they_differ(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with open_store(f"sqlite:///{tmp_path / 'a.db'}") as a, open_store(f"sqlite:///{tmp_path / 'b.db'}") as b:
            await a.put(*_halves(1))
            await b.put(*pair_of(1))
            assert await copy(a, b, lambda *_: None) == Tally(different=[IDS[0]])

    asyncio.run(scenario())


def test_rounded_functions_are_float16_numbers_or_stay_as_they_are() -> None:
    record, functions = pair_of(1)
    kept = rounded(SPEC, functions, "float16")
    np.testing.assert_array_equal(kept.theta, kept.theta.astype(np.float16).astype(np.float32))
    np.testing.assert_allclose(kept.theta, functions.theta, rtol=2**-10)  # a neighbor of each number
    assert rounded(SPEC, functions, "float32") is functions
    assert rounded(SPEC, kept, "float16").theta.tolist() == kept.theta.tolist()
    beyond = Functions(np.float32(1e6) * initial_theta(SPEC, 1))
    assert rounded(SPEC, beyond, "float16") is beyond
    assert record.color_spec == COLOR


def test_rounded_with_points_that_would_move_too_far_stays_as_it_is() -> None:
    """A large bias that both layers cancel: float16 has no digits left for the shape itself."""
    theta = initial_theta(SPEC, 1)
    hidden = SPEC.hidden[0]
    theta[3 * hidden : 4 * hidden] += np.float32(500)
    functions = Functions(theta)
    assert rounded(SPEC, functions, "float16") is functions
