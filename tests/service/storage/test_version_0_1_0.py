"""A database that version 0.1.0 wrote (commit 223bede, SQLite's dump) loads unchanged and gives the same points."""

import asyncio
import io
import sqlite3
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

import httpx
import numpy as np
import pytest

from service.mapping.sampler import Sampler
from service.mapping.spec import Color, Functions, MappingSpec, initial_theta, join_functions, word_of
from service.settings import Settings
from service.storage.ids import composed_id, imported_id, interpolated_id
from service.storage.rows import Record
from tests.support.server import running
from tests.support.small.store import open_store

DUMP = Path(__file__).parent / "schemas" / "version-0.1.0.sqlite.sql"
SPEC, COLOR_SPEC = MappingSpec("tiny", 3, (8,), 3, k=2), MappingSpec("tiny-color", 3, (4,), 3)
CREATED_AT = datetime(2026, 11, 20, 9, 30, 0, 123456, UTC)

PLAIN = Functions(initial_theta(SPEC, 1))
COLORED = Functions(initial_theta(SPEC, 2), Color(COLOR_SPEC, initial_theta(COLOR_SPEC, 3)))
MEAN = Functions((PLAIN.theta + COLORED.theta) / np.float32(2))
WORD = (imported_id(SPEC, PLAIN), imported_id(SPEC, COLORED))

POINTS = {  # points 0 to 2 of seed 5, as version 0.1.0 computed them
    "imported": [
        [0.39820588, 0.42342657, 0.2689839],
        [0.39363807, 0.4179762, 0.27515924],
        [0.38509232, 0.40765893, 0.2871027],
    ],
    "encoded": [
        [0.14379489, 0.12578666, -0.060459651],
        [0.14537096, 0.12556466, -0.058823131],
        [0.12776232, 0.12318237, -0.047559328],
    ],
    "composed": [
        [0.37044212, 0.38918406, 0.29197264],
        [0.37165236, 0.39033991, 0.31787848],
        [0.38407418, 0.40542012, 0.2874974],
    ],
    "interpolated": [
        [0.25069904, 0.31021613, 0.054960817],
        [0.24893321, 0.31080291, 0.054487534],
        [0.24916685, 0.31011191, 0.055851996],
    ],
}
OBJECTS = [  # oldest first: record, functions, points
    (Record(WORD[0], "imported", "tiny-k2", SPEC, CREATED_AT), PLAIN, POINTS["imported"]),
    (Record(WORD[1], "encoded", "tiny-k2", SPEC, CREATED_AT, (), COLOR_SPEC), COLORED, POINTS["encoded"]),
    (
        Record(composed_id(WORD), "composed", "tiny-k2", SPEC, CREATED_AT, WORD, COLOR_SPEC),
        join_functions([PLAIN, COLORED]),
        POINTS["composed"],
    ),
    (Record(interpolated_id(WORD), "interpolated", "tiny-k2", SPEC, CREATED_AT, WORD), MEAN, POINTS["interpolated"]),
]


@pytest.fixture
def database_url(tmp_path: Path) -> str:
    """Restore the database from the dump; return its URL."""
    with closing(sqlite3.connect(tmp_path / "hof.db")) as connection:
        connection.executescript(DUMP.read_text("utf-8"))
    return f"sqlite:///{tmp_path / 'hof.db'}"


def _points(spec: MappingSpec, functions: Functions) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return Sampler(spec, word_of(spec, functions.theta)).points(3, seed=5)


def test_store_of_version_0_1_0_returns_the_same_bits_and_points(database_url: str) -> None:
    async def scenario() -> list[tuple[Record, Functions]]:
        async with open_store(database_url) as store:
            newest_first, cursor = await store.page(9)
            assert cursor is None
            return [await store.get(record.id) for record in reversed(newest_first)]

    stored = asyncio.run(scenario())
    assert [record for record, _ in stored] == [record for record, _, _ in OBJECTS]
    for (record, functions), (_, expected, points) in zip(stored, OBJECTS, strict=True):
        np.testing.assert_array_equal(functions.theta, expected.theta)
        assert (functions.color is None) == (expected.color is None)
        if functions.color and expected.color:
            assert functions.color.spec == COLOR_SPEC
            np.testing.assert_array_equal(functions.color.weights, expected.color.weights)
        np.testing.assert_array_equal(_points(record.spec, functions), _points(SPEC, expected))
        np.testing.assert_allclose(_points(record.spec, functions), points, atol=1e-6)  # machines round differently


def test_store_of_version_0_1_0_when_opened_keeps_its_rows(database_url: str) -> None:
    """Opening it adds columns, and changes no value of a row; opening it again changes nothing."""

    async def open_and_close() -> None:
        async with open_store(database_url):
            pass

    def rows() -> list[tuple[object, ...]]:
        columns = "seq, id, kind, created_at, model, spec, members, theta, color, color_spec"
        with closing(sqlite3.connect(database_url.removeprefix("sqlite:///"))) as connection:
            return list(connection.execute(f"SELECT {columns} FROM objects ORDER BY seq"))

    def dump() -> list[str]:
        with closing(sqlite3.connect(database_url.removeprefix("sqlite:///"))) as connection:
            return list(connection.iterdump())

    before = rows()
    asyncio.run(open_and_close())
    assert rows() == before
    migrated = dump()
    asyncio.run(open_and_close())
    assert dump() == migrated


def test_object_of_version_0_1_0_is_measured_when_first_read(database_url: str, model_path: Path) -> None:
    settings = Settings(model=(model_path,), database_url=database_url, threads=1)
    with running(settings) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}") as client:
        listed = client.get("/objects").json()["items"]
        assert len(listed) == len(OBJECTS)
        assert not any("dimensions" in item or "frame" in item for item in listed)
        points = np.load(io.BytesIO(client.get(f"{listed[0]['links']['points']}?format=npy").content))
        for item in listed:
            stored = client.get(item["links"]["self"]).json()
            assert max(stored["dimensions"]) == 1
        assert all("frame" in item for item in client.get("/objects").json()["items"])
        again = np.load(io.BytesIO(client.get(f"{listed[0]['links']['points']}?format=npy").content))
    np.testing.assert_array_equal(points, again)
    assert np.ptp(points, axis=0).max() == pytest.approx(1, abs=0.05)
