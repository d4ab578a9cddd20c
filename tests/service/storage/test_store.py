"""The store on SQLite and on PostgreSQL: puts, reads and pages of objects with a theta."""

import asyncio
import subprocess
import sys
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from service.encoding.estimates import Camera, Estimates
from service.errors import InvalidParameter, NotFound
from service.mapping.spec import HOF_1, Functions, initial_theta
from service.storage.rows import Record
from tests.support.small.store import SPEC, THETA, encoded_record, open_store
from tests.support.systems.postgres import EVERY_DATABASE

pytestmark = EVERY_DATABASE

ROOT = Path(__file__).parents[3]
LIST = """
import asyncio, sys
from service.storage.store import Store

async def main():
    store = await Store.open(sys.argv[1])
    for record in (await store.page(9))[0]:
        print(record.id, (await store.get(record.id))[1].theta.nbytes)
    await store.close()

asyncio.run(main())
"""


def test_get_from_a_store_opened_again_returns_the_same_bits(database_url: str) -> None:
    spec = HOF_1.with_k(2)
    theta = initial_theta(spec, 7)

    async def scenario() -> tuple[Record, Functions]:
        async with open_store(database_url) as store:
            assert await store.put(encoded_record("a", spec), Functions(theta)) == (encoded_record("a", spec), True)
        async with open_store(database_url) as store:
            return await store.get("a")

    record, functions = asyncio.run(scenario())
    assert record == encoded_record("a", spec)
    assert record.created_at.tzinfo == UTC
    assert functions.theta.dtype == np.float32
    np.testing.assert_array_equal(functions.theta, theta)
    assert functions.color is None


def test_put_of_an_existing_id_keeps_and_returns_the_first_object(database_url: str) -> None:
    async def scenario() -> None:
        async with open_store(database_url) as store:
            await store.put(encoded_record("a"), Functions(THETA))
            later = Record("a", "imported", "other", SPEC, datetime(2027, 1, 1, tzinfo=UTC))
            assert await store.put(later, Functions(THETA + 1)) == (encoded_record("a"), False)
            _, functions = await store.get("a")
            np.testing.assert_array_equal(functions.theta, THETA)

    asyncio.run(scenario())


def test_put_of_one_id_by_two_stores_at_once_is_new_exactly_once(database_url: str) -> None:
    async def scenario() -> list[bool]:
        async with open_store(database_url) as one, open_store(database_url) as two:
            puts = [store.put(encoded_record("a"), Functions(THETA)) for store in (one, two) for _ in range(10)]
            return [new for _, new in await asyncio.gather(*puts)]

    assert sorted(asyncio.run(scenario())) == [False] * 19 + [True]


def test_put_that_returned_is_visible_to_another_process(database_url: str) -> None:
    async def scenario() -> list[str]:
        async with open_store(database_url) as store:
            await store.put(encoded_record("a"), Functions(THETA))
            return await asyncio.to_thread(_elsewhere)

    def _elsewhere() -> list[str]:
        run = subprocess.run(
            [sys.executable, "-c", LIST, database_url], cwd=ROOT, check=True, capture_output=True, text=True
        )
        return run.stdout.split()

    assert asyncio.run(scenario()) == ["a", str(THETA.nbytes)]


def test_get_and_delete_of_an_unknown_id_raise_not_found(database_url: str) -> None:
    async def scenario() -> None:
        async with open_store(database_url) as store:
            assert await store.find("a") is None
            with pytest.raises(NotFound):
                await store.get("a")
            with pytest.raises(NotFound):
                await store.delete("a")

    asyncio.run(scenario())


def test_page_under_inserts_and_deletes_stays_newest_first_and_complete(database_url: str) -> None:
    async def scenario() -> None:
        async with open_store(database_url) as store:
            for name in "abcdefg":
                await store.put(encoded_record(name), Functions(THETA))
            page, cursor = await store.page(3)
            assert [record.id for record in page] == ["g", "f", "e"]
            await store.put(encoded_record("h"), Functions(THETA))
            await store.delete("e")  # the last one seen
            await store.delete("g")
            page, cursor = await store.page(3, cursor)
            assert [record.id for record in page] == ["d", "c", "b"]
            page, cursor = await store.page(3, cursor)
            assert ([record.id for record in page], cursor) == (["a"], None)
            page, cursor = await store.page(6)
            assert ([record.id for record in page], cursor) == (["h", "f", "d", "c", "b", "a"], None)

    asyncio.run(scenario())


def test_page_of_an_empty_store_is_empty(database_url: str) -> None:
    async def scenario() -> tuple[list[Record], str | None]:
        async with open_store(database_url) as store:
            return await store.page(5)

    assert asyncio.run(scenario()) == ([], None)


@pytest.mark.parametrize(
    "cursor", ["", "x", "MQ==", "LTE", "MA", "ICAx", "é", "\x00", "OTk5OTk5OTk5OTk5OTk5OTk5OTk5OQ", "2" * 60]
)
def test_page_with_an_invalid_cursor_is_refused(database_url: str, cursor: str) -> None:
    async def scenario() -> None:
        async with open_store(database_url) as store:
            await store.page(1, cursor)

    with pytest.raises(InvalidParameter) as caught:
        asyncio.run(scenario())
    assert caught.value.field == "cursor"


def test_store_keeps_the_estimates_of_an_object(database_url: str) -> None:
    estimates = Estimates(0.57, Camera(-31.5, 18.2, 2.9, 0.4))

    async def scenario() -> list[Estimates | None]:
        async with open_store(database_url) as store:
            await store.put(replace(encoded_record("a"), estimates=estimates), Functions(THETA))
            await store.put(encoded_record("b"), Functions(THETA))
            return [(await store.record(name)).estimates for name in ("a", "b")]

    assert asyncio.run(scenario()) == [estimates, None]
