"""The store, on SQLite and on PostgreSQL."""

import asyncio
import subprocess
import sys
from collections.abc import AsyncIterator, Awaitable
from contextlib import asynccontextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from conftest import EVERY_DATABASE

from service.errors import InUse, InvalidParameter, NotFound
from service.mapping import HOF_1, Color, Functions, MappingSpec, initial_theta
from service.store import Record, Store

pytestmark = EVERY_DATABASE

ROOT = Path(__file__).parents[1]
SPEC = MappingSpec("tiny", 3, (4,), 3, k=2)
NOW = datetime(2026, 1, 2, 3, 4, 5, 678901, UTC)


def _record(name: str, spec: MappingSpec = SPEC) -> Record:
    return Record(name, "encoded", "tiny-k2", spec, NOW)


THETA = initial_theta(SPEC)
LIST = """
import asyncio, sys
from service.store import Store

async def main():
    store = await Store.open(sys.argv[1])
    for record in (await store.page(9))[0]:
        print(record.id, (await store.get(record.id))[1].theta.nbytes)
    await store.close()

asyncio.run(main())
"""


@asynccontextmanager
async def _open(url: str) -> AsyncIterator[Store]:
    store = await Store.open(url)
    try:
        yield store
    finally:
        await store.close()


def test_an_object_comes_back_bit_for_bit_from_a_store_opened_again(database_url: str) -> None:
    spec = HOF_1.with_k(2)
    theta = initial_theta(spec, 7)

    async def scenario() -> tuple[Record, Functions]:
        async with _open(database_url) as store:
            assert await store.put(_record("a", spec), Functions(theta)) == (_record("a", spec), True)
        async with _open(database_url) as store:
            return await store.get("a")

    record, found = asyncio.run(scenario())
    assert record == _record("a", spec)
    assert record.created_at.tzinfo == UTC
    assert found.theta.dtype == np.float32
    np.testing.assert_array_equal(found.theta, theta)
    assert found.color is None


def test_a_second_put_keeps_and_returns_the_first(database_url: str) -> None:
    async def scenario() -> None:
        async with _open(database_url) as store:
            await store.put(_record("a"), Functions(THETA))
            later = Record("a", "imported", "other", SPEC, datetime(2027, 1, 1, tzinfo=UTC))
            assert await store.put(later, Functions(THETA + 1)) == (_record("a"), False)
            _, found = await store.get("a")
            np.testing.assert_array_equal(found.theta, THETA)

    asyncio.run(scenario())


def test_of_concurrent_puts_from_two_processes_worth_of_stores_one_is_new(database_url: str) -> None:
    async def scenario() -> list[bool]:
        async with _open(database_url) as one, _open(database_url) as two:
            puts = [store.put(_record("a"), Functions(THETA)) for store in (one, two) for _ in range(10)]
            return [new for _, new in await asyncio.gather(*puts)]

    assert sorted(asyncio.run(scenario())) == [False] * 19 + [True]


def test_another_process_reads_what_is_acknowledged_while_the_store_is_open(database_url: str) -> None:
    async def scenario() -> list[str]:
        async with _open(database_url) as store:
            await store.put(_record("a"), Functions(THETA))
            return await asyncio.to_thread(_elsewhere)

    def _elsewhere() -> list[str]:
        run = subprocess.run(
            [sys.executable, "-c", LIST, database_url], cwd=ROOT, check=True, capture_output=True, text=True
        )
        return run.stdout.split()

    assert asyncio.run(scenario()) == ["a", str(THETA.nbytes)]


def test_unknown_ids_are_not_found(database_url: str) -> None:
    async def scenario() -> None:
        async with _open(database_url) as store:
            assert await store.find("a") is None
            with pytest.raises(NotFound):
                await store.get("a")
            with pytest.raises(NotFound):
                await store.delete("a")

    asyncio.run(scenario())


def test_pages_are_newest_first_and_stable_under_inserts_and_deletes(database_url: str) -> None:
    async def scenario() -> None:
        async with _open(database_url) as store:
            for name in "abcdefg":
                await store.put(_record(name), Functions(THETA))
            page, cursor = await store.page(3)
            assert [record.id for record in page] == ["g", "f", "e"]
            await store.put(_record("h"), Functions(THETA))
            await store.delete("e")  # the last one seen
            await store.delete("g")
            page, cursor = await store.page(3, cursor)
            assert [record.id for record in page] == ["d", "c", "b"]
            page, cursor = await store.page(3, cursor)
            assert ([record.id for record in page], cursor) == (["a"], None)
            page, cursor = await store.page(6)
            assert ([record.id for record in page], cursor) == (["h", "f", "d", "c", "b", "a"], None)

    asyncio.run(scenario())


def test_an_empty_store_has_an_empty_page(database_url: str) -> None:
    async def scenario() -> tuple[list[Record], str | None]:
        async with _open(database_url) as store:
            return await store.page(5)

    assert asyncio.run(scenario()) == ([], None)


@pytest.mark.parametrize(
    "cursor", ["", "x", "MQ==", "LTE", "MA", "ICAx", "é", "\x00", "OTk5OTk5OTk5OTk5OTk5OTk5OTk5OQ", "2" * 60]
)
def test_a_cursor_that_no_page_gave_is_refused(database_url: str, cursor: str) -> None:
    async def scenario() -> None:
        async with _open(database_url) as store:
            await store.page(1, cursor)

    with pytest.raises(InvalidParameter) as caught:
        asyncio.run(scenario())
    assert caught.value.field == "cursor"


# Words


def _composed(name: str, *word: str) -> Record:
    return Record(name, "composed", "tiny-k2", SPEC, NOW, word)


def test_a_composed_object_has_the_thetas_of_its_word(database_url: str) -> None:
    async def scenario() -> tuple[Record, Functions]:
        async with _open(database_url) as store:
            for index, name in enumerate("ab"):
                await store.put(_record(name), Functions(THETA + index))
            assert await store.put(_composed("bab", "b", "a", "b"), None) == (_composed("bab", "b", "a", "b"), True)
            assert await store.put(_composed("bab", "b", "a", "b"), None) == (_composed("bab", "b", "a", "b"), False)
        async with _open(database_url) as store:
            return await store.get("bab")

    record, functions = asyncio.run(scenario())
    assert record == _composed("bab", "b", "a", "b")
    assert functions.theta.dtype == np.float32
    np.testing.assert_array_equal(functions.theta, [THETA + 1, THETA, THETA + 1])


def test_a_colour_comes_back_bit_for_bit_and_a_word_has_those_of_its_functions(database_url: str) -> None:
    spec = MappingSpec("colour", 3, (5,), 3)
    weights = initial_theta(spec, 3)
    red = Record("red", "encoded", "tiny-k2", SPEC, NOW, color_spec=spec)
    word = Record("word", "composed", "tiny-k2", SPEC, NOW, ("red", "plain", "red"), spec)

    async def scenario() -> tuple[tuple[Record, Functions], tuple[Record, Functions]]:
        async with _open(database_url) as store:
            await store.put(red, Functions(THETA, Color(spec, weights)))
            await store.put(_record("plain"), Functions(THETA))
            await store.put(word, None)
        async with _open(database_url) as store:
            assert (await store.page(1))[0] == [word]
            return await store.get("red"), await store.get("word")

    (found_red, one), (found_word, two) = asyncio.run(scenario())
    assert (found_red, found_word) == (red, word)
    assert one.color
    assert two.color
    assert one.color.spec == two.color.spec == spec
    assert one.color.weights.dtype == np.float32
    np.testing.assert_array_equal(one.color.weights, weights)
    np.testing.assert_array_equal(two.color.weights, [weights, weights])


def test_a_word_of_a_missing_object_is_refused_and_not_kept(database_url: str) -> None:
    async def scenario() -> None:
        async with _open(database_url) as store:
            await store.put(_record("a"), Functions(THETA))
            with pytest.raises(NotFound, match="no object gone any more"):
                await store.put(_composed("ab", "a", "gone"), None)
            assert await store.records(["a", "ab", "gone"]) == {"a": _record("a")}
            await store.delete("a")

    asyncio.run(scenario())


def test_an_object_that_words_use_stays(database_url: str) -> None:
    async def scenario() -> None:
        async with _open(database_url) as store:
            await store.put(_record("a"), Functions(THETA))
            names = [f"word{index}" for index in range(12)]
            for name in names:
                await store.put(_composed(name, "a", "a"), None)
            with pytest.raises(InUse, match=r"made of it: word0, .*, word9 and 2 more; delete") as caught:
                await store.delete("a")
            assert "word10" not in caught.value.detail
            for name in names:
                await store.delete(name)
            await store.delete("a")
            assert await store.page(5) == ([], None)

    asyncio.run(scenario())


def test_an_interpolated_object_keeps_parents_that_are_gone(database_url: str) -> None:
    mean = Record("mean", "interpolated", "tiny-k2", SPEC, NOW, ("a", "gone"))

    async def scenario() -> tuple[Record, Functions]:
        async with _open(database_url) as store:
            await store.put(_record("a"), Functions(THETA))
            await store.put(mean, Functions(THETA))
            await store.delete("a")
            return await store.get("mean")

    record, functions = asyncio.run(scenario())
    assert record == mean
    np.testing.assert_array_equal(functions.theta, THETA)


def test_of_composing_and_deleting_at_once_one_wins(database_url: str) -> None:
    async def attempt(action: Awaitable[object]) -> bool:
        try:
            await action
        except (NotFound, InUse):
            return False
        return True

    async def scenario() -> None:
        async with _open(database_url) as one, _open(database_url) as two:
            for index in range(30):
                name, word = f"a{index}", f"word{index}"
                await one.put(_record(name), Functions(THETA))
                actions = [one.put(_composed(word, name, name), None), two.delete(name)]
                if index % 2:
                    actions.reverse()
                results = await asyncio.gather(*map(attempt, actions))
                assert sorted(results) == [False, True]
                found = await one.records([name, word])
                assert found.keys() in ({name, word}, set())

    asyncio.run(scenario())


# Several at once


def test_of_several_objects_all_are_kept_or_none(database_url: str) -> None:
    async def scenario() -> None:
        async with _open(database_url) as store:
            await store.put(_record("a"), Functions(THETA))
            with pytest.raises(NotFound, match="no object gone any more"):
                await store.put_all([(_composed("aa", "a", "a"), None), (_composed("ag", "a", "gone"), None)])
            assert [record.id for record in (await store.page(5))[0]] == ["a"]
            await store.put(_composed("aa", "a", "a"), None)
            both = [_record("b"), _composed("aa", "a", "a"), _record("c")]
            later = [replace(record, created_at=datetime(2027, 1, 1, tzinfo=UTC)) for record in both]
            proposed = [(record, None if record.members else Functions(THETA)) for record in later]
            kept, any_new = await store.put_all(proposed)
            assert (kept, any_new) == ([later[0], both[1], later[2]], True)
            assert await store.put_all([(record, None) for record in both]) == (kept, False)

    asyncio.run(scenario())


def test_the_same_words_in_opposite_orders_do_not_lock_each_other_out(database_url: str) -> None:
    async def scenario() -> list[bool]:
        async with _open(database_url) as one, _open(database_url) as two:
            for name in "ab":
                await one.put(_record(name), Functions(THETA))
            new = []
            for index in range(10):
                words = [(_composed(f"{index}{x}{y}", x, y), None) for x in "ab" for y in "ab"]
                calls = [store.put_all(order) for store in (one, two) for order in (words, words[::-1])]
                new.append(sum(any_new for _, any_new in await asyncio.gather(*calls)) == 1)
            return new

    assert asyncio.run(scenario()) == [True] * 10
