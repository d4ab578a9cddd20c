"""The store on SQLite and on PostgreSQL: words, and the objects that they use."""

import asyncio
import sqlite3
from collections.abc import Awaitable
from contextlib import closing
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pytest

from service.errors import InUse, NotFound
from service.mapping.spec import Color, Functions, MappingSpec, initial_theta
from service.storage.rows import Record
from tests.support.small.store import NOW, SPEC, THETA, encoded_record, open_store
from tests.support.systems.postgres import EVERY_DATABASE, Postgres

pytestmark = EVERY_DATABASE


def _composed(name: str, *word: str) -> Record:
    return Record(name, "composed", "tiny-k2", SPEC, NOW, word)


def test_get_of_a_composed_object_returns_the_thetas_of_its_word(database_url: str) -> None:
    async def scenario() -> tuple[Record, Functions]:
        async with open_store(database_url) as store:
            for index, name in enumerate("ab"):
                await store.put(encoded_record(name), Functions(THETA + index))
            assert await store.put(_composed("bab", "b", "a", "b"), None) == (_composed("bab", "b", "a", "b"), True)
            assert await store.put(_composed("bab", "b", "a", "b"), None) == (_composed("bab", "b", "a", "b"), False)
        async with open_store(database_url) as store:
            return await store.get("bab")

    record, functions = asyncio.run(scenario())
    assert record == _composed("bab", "b", "a", "b")
    assert functions.theta.dtype == np.float32
    np.testing.assert_array_equal(functions.theta, [THETA + 1, THETA, THETA + 1])


def test_get_with_color_returns_the_same_bits_and_a_words_colors(database_url: str) -> None:
    spec = MappingSpec("color", 3, (5,), 3)
    weights = initial_theta(spec, 3)
    red = Record("red", "encoded", "tiny-k2", SPEC, NOW, color_spec=spec)
    word = Record("word", "composed", "tiny-k2", SPEC, NOW, ("red", "plain", "red"), spec)

    async def scenario() -> tuple[tuple[Record, Functions], tuple[Record, Functions]]:
        async with open_store(database_url) as store:
            await store.put(red, Functions(THETA, Color(spec, weights)))
            await store.put(encoded_record("plain"), Functions(THETA))
            await store.put(word, None)
        async with open_store(database_url) as store:
            assert (await store.page(1))[0] == [word]
            return await store.get("red"), await store.get("word")

    (red_record, one), (word_record, two) = asyncio.run(scenario())
    assert (red_record, word_record) == (red, word)
    assert one.color
    assert two.color
    assert one.color.spec == two.color.spec == spec
    assert one.color.weights.dtype == np.float32
    np.testing.assert_array_equal(one.color.weights, weights)
    np.testing.assert_array_equal(two.color.weights, [weights, weights])


def test_put_of_a_word_over_a_missing_object_is_refused_and_stores_nothing(database_url: str) -> None:
    async def scenario() -> None:
        async with open_store(database_url) as store:
            await store.put(encoded_record("a"), Functions(THETA))
            with pytest.raises(NotFound, match="the word names the object gone, which no longer exists"):
                await store.put(_composed("ab", "a", "gone"), None)
            assert await store.records(["a", "ab", "gone"]) == {"a": encoded_record("a")}
            await store.delete("a")

    asyncio.run(scenario())


def test_delete_of_an_object_that_words_use_is_refused(database_url: str) -> None:
    async def scenario() -> None:
        async with open_store(database_url) as store:
            await store.put(encoded_record("a"), Functions(THETA))
            names = [f"word{index}" for index in range(12)]
            for name in names:
                await store.put(_composed(name, "a", "a"), None)
            with pytest.raises(InUse, match=r"objects use it: word0, .*, word9 and 2 more; delete") as caught:
                await store.delete("a")
            assert "word10" not in caught.value.detail
            for name in names:
                await store.delete(name)
            await store.delete("a")
            assert await store.page(5) == ([], None)

    asyncio.run(scenario())


def test_get_of_an_interpolated_object_keeps_deleted_parents(database_url: str) -> None:
    mean = Record("mean", "interpolated", "tiny-k2", SPEC, NOW, ("a", "gone"))

    async def scenario() -> tuple[Record, Functions]:
        async with open_store(database_url) as store:
            await store.put(encoded_record("a"), Functions(THETA))
            await store.put(mean, Functions(THETA))
            await store.delete("a")
            return await store.get("mean")

    record, functions = asyncio.run(scenario())
    assert record == mean
    np.testing.assert_array_equal(functions.theta, THETA)


def test_put_of_a_word_and_delete_at_once_exactly_one_succeeds(database_url: str) -> None:
    async def attempt(action: Awaitable[object]) -> bool:
        try:
            await action
        except (NotFound, InUse):
            return False
        return True

    async def scenario() -> None:
        async with open_store(database_url) as one, open_store(database_url) as two:
            for index in range(30):
                name, word = f"a{index}", f"word{index}"
                await one.put(encoded_record(name), Functions(THETA))
                actions = [one.put(_composed(word, name, name), None), two.delete(name)]
                if index % 2:
                    actions.reverse()
                results = await asyncio.gather(*map(attempt, actions))
                assert sorted(results) == [False, True]
                records = await one.records([name, word])
                assert records.keys() in ({name, word}, set())

    asyncio.run(scenario())


# Several at once


def test_put_all_with_a_refused_object_stores_none(database_url: str) -> None:
    async def scenario() -> None:
        async with open_store(database_url) as store:
            await store.put(encoded_record("a"), Functions(THETA))
            with pytest.raises(NotFound, match="the word names the object gone, which no longer exists"):
                await store.put_all([(_composed("aa", "a", "a"), None), (_composed("ag", "a", "gone"), None)])
            assert [record.id for record in (await store.page(5))[0]] == ["a"]
            await store.put(_composed("aa", "a", "a"), None)
            both = [encoded_record("b"), _composed("aa", "a", "a"), encoded_record("c")]
            later = [replace(record, created_at=datetime(2027, 1, 1, tzinfo=UTC)) for record in both]
            proposed = [(record, None if record.members else Functions(THETA)) for record in later]
            kept, any_new = await store.put_all(proposed)
            assert (kept, any_new) == ([later[0], both[1], later[2]], True)
            assert await store.put_all([(record, None) for record in both]) == (kept, False)

    asyncio.run(scenario())


def test_put_all_of_the_same_words_in_opposite_orders_does_not_deadlock(database_url: str) -> None:
    async def scenario() -> list[bool]:
        async with open_store(database_url) as one, open_store(database_url) as two:
            for name in "ab":
                await one.put(encoded_record(name), Functions(THETA))
            new = []
            for index in range(10):
                words = [(_composed(f"{index}{x}{y}", x, y), None) for x in "ab" for y in "ab"]
                calls = [store.put_all(order) for store in (one, two) for order in (words, words[::-1])]
                new.append(sum(any_new for _, any_new in await asyncio.gather(*calls)) == 1)
            return new

    assert asyncio.run(scenario()) == [True] * 10


def _leave_orphan(database_url: str, request: pytest.FixtureRequest, composed: str, member: str) -> None:
    """Add a row as programs do that do not check foreign keys."""
    sql = f"INSERT INTO uses (composed_id, member_id) VALUES ('{composed}', '{member}')"
    if database_url.startswith("sqlite:///"):
        with closing(sqlite3.connect(database_url.removeprefix("sqlite:///"), isolation_level=None)) as connection:
            connection.execute(sql)
        return
    postgres: Postgres = request.getfixturevalue("postgres")
    postgres.run(f"SET session_replication_role = replica; {sql}", database_url.rpartition("/")[2])


def test_orphaned_use_stops_neither_delete_nor_put(database_url: str, request: pytest.FixtureRequest) -> None:
    async def scenario() -> None:
        async with asyncio.timeout(60), open_store(database_url) as store:
            for name in "abc":
                await store.put(encoded_record(name), Functions(THETA))
            _leave_orphan(database_url, request, "gone", "a")
            _leave_orphan(database_url, request, "bc", "b")
            assert (await store.put(_composed("bc", "b", "c"), None))[1]
            with pytest.raises(InUse, match="bc"):
                await store.delete("b")
            await store.delete("a")
            assert await store.find("a") is None

    asyncio.run(scenario())
