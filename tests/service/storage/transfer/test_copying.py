"""Copies of whole stores between SQLite and PostgreSQL."""

import asyncio
from pathlib import Path

import numpy as np
import pytest

from service.mapping.spec import Functions
from service.storage import rows
from service.storage.transfer.content import Tally
from service.storage.transfer.copying import copy
from tests.support.small.store import PHOTO, digests, fill, open_store, pair_of
from tests.support.systems.postgres import EVERY_DATABASE


def _ignore(done: int, total: int) -> None:
    pass


@EVERY_DATABASE
def test_copy_there_and_back_keeps_every_object_and_their_order(database_url: str, tmp_path: Path) -> None:
    async def scenario() -> None:
        async with open_store(f"sqlite:///{tmp_path / 'a.db'}") as a, open_store(database_url) as b:
            ids = await fill(a)
            reports: list[tuple[int, int]] = []
            assert await copy(a, b, lambda done, total: reports.append((done, total))) == Tally(copied=6)
            assert reports == [(6, 6)]
            async with open_store(f"sqlite:///{tmp_path / 'c.db'}") as c:
                assert await copy(b, c, _ignore) == Tally(copied=6)
                page, _ = await c.page(10)
                assert [record.id for record in page] == ids[::-1]
                assert page == (await a.page(10))[0]
                assert await digests(c) == await digests(a)
                assert [await c.photo(name) for name in ids] == [None, PHOTO, None, None, None, None]
                _, functions = await c.get(ids[-1])
                np.testing.assert_array_equal(functions.theta, (await a.get(ids[-1]))[1].theta)

    asyncio.run(scenario())


@EVERY_DATABASE
def test_copy_that_broke_off_is_continued(database_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows, "BATCH_ROWS", 2)

    async def scenario() -> None:
        async with open_store(f"sqlite:///{tmp_path / 'a.db'}") as a, open_store(database_url) as b:
            await fill(a)

            def leave(done: int, total: int) -> None:
                if done >= 4:
                    raise ConnectionError

            with pytest.raises(ConnectionError):
                await copy(a, b, leave)
            assert await b.count() == 4
            assert await copy(a, b, _ignore) == Tally(copied=2, present=4)
            assert await digests(b) == await digests(a)

    asyncio.run(scenario())


def test_copy_reports_other_content_under_an_id_and_keeps_it(database_url: str, tmp_path: Path) -> None:
    async def scenario() -> None:
        async with open_store(f"sqlite:///{tmp_path / 'a.db'}") as a, open_store(database_url) as b:
            ids = await fill(a)
            record, functions = pair_of(0)
            theta = functions.theta.copy()
            theta[3] += 1
            await b.put(record, Functions(theta, functions.color))
            assert await copy(a, b, _ignore) == Tally(copied=5, different=[ids[0]])
            np.testing.assert_array_equal((await b.get(ids[0]))[1].theta, theta)

    asyncio.run(scenario())


def test_copy_leaves_out_objects_that_arrive_after_its_start(database_url: str, tmp_path: Path) -> None:
    async def scenario() -> None:
        async with open_store(f"sqlite:///{tmp_path / 'a.db'}") as a, open_store(database_url) as b:
            await a.put(*pair_of(0))
            last = await a.last_seq()
            await a.put(*pair_of(1))
            assert [entry.record.id for entry in await a.entries(0, last)] == [pair_of(0)[0].id]
            assert await copy(a, b, _ignore) == Tally(copied=2)

    asyncio.run(scenario())


@EVERY_DATABASE
def test_entries_hold_at_most_so_many_bytes_and_at_least_one(
    database_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    functions = pair_of(0)[1]
    assert functions.color
    size = functions.theta.nbytes + functions.color.weights.nbytes

    async def counts(limit: int) -> list[int]:
        monkeypatch.setattr(rows, "BATCH_BYTES", limit)
        async with open_store(database_url) as store:
            for number in range(4):
                await store.put(*pair_of(number))
            last, after, counts = await store.last_seq(), 0, []
            while entries := await store.entries(after, last):
                after = entries[-1].seq
                counts.append(len(entries))
            return counts

    assert asyncio.run(counts(3 * size)) == [3, 1]
    assert asyncio.run(counts(size - 1)) == [1, 1, 1, 1]
