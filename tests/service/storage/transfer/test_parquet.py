"""Stores as Parquet files."""

import asyncio
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from service.errors import CorruptWeights, HofError, NotFound
from service.storage.transfer.content import Tally
from service.storage.transfer.parquet import export, import_file
from tests.support.small.store import COLOR, SPEC, fill, open_store, pair_of
from tests.support.systems.postgres import EVERY_DATABASE


def _ignore(done: int, total: int) -> None:
    pass


def _exported(folder: Path, *, mixed: bool = True) -> Path:
    async def scenario() -> None:
        async with open_store(f"sqlite:///{folder / 'source.db'}") as store:
            if mixed:
                await fill(store)
            for number in range(2):
                await store.put(*pair_of(number))
            await export(store, folder / "objects.parquet", _ignore)

    asyncio.run(scenario())
    return folder / "objects.parquet"


def _imported(url: str, path: Path) -> Tally:
    async def scenario() -> Tally:
        async with open_store(url) as store:
            return await import_file(store, path, _ignore)

    return asyncio.run(scenario())


def _changed(path: Path, name: str, values: list[Any]) -> Path:
    """Write the table again with other values in a column."""
    table = pq.read_table(path)
    place = table.schema.get_field_index(name)
    other = path.with_name("changed.parquet")
    pq.write_table(table.set_column(place, name, pa.array(values, table.schema.field(name).type)), other)
    return other


@EVERY_DATABASE
def test_import_of_an_export_restores_every_object(database_url: str, tmp_path: Path) -> None:
    path = _exported(tmp_path)
    assert _imported(database_url, path) == Tally(copied=6)
    assert _imported(database_url, path) == Tally(present=6)

    async def scenario() -> None:
        async with open_store(database_url) as store, open_store(f"sqlite:///{tmp_path / 'source.db'}") as source:
            assert await store.page(10) == await source.page(10)
            for record in (await store.page(10))[0]:
                _, functions = await store.get(record.id)
                _, before = await source.get(record.id)
                np.testing.assert_array_equal(functions.theta, before.theta)
                assert (functions.color is None) == (before.color is None)
                assert await store.photo(record.id) == await source.photo(record.id)

    asyncio.run(scenario())


def test_export_of_one_spec_has_lists_of_fixed_size(tmp_path: Path) -> None:
    table = pq.read_table(_exported(tmp_path, mixed=False))
    record, functions = pair_of(0)
    assert table.schema.field("theta").type == pa.list_(pa.float32(), SPEC.size)
    assert table.schema.field("color").type == pa.list_(pa.float32(), COLOR.size)
    row = table.slice(0, 1).to_pylist()[0]
    assert functions.color
    assert row["theta"] == functions.theta.tolist()
    assert row["color"] == functions.color.weights.tolist()
    assert row["dimensions"] == [1.0, 0.5, 0.25]
    assert (row["id"], row["kind"], row["mask"], row["box"]) == (record.id, "encoded", "border", [1, 2, 3, 4])
    assert row["created_at"] == record.created_at


def test_export_of_an_empty_store_can_be_imported(tmp_path: Path, database_url: str) -> None:
    async def scenario() -> int:
        async with open_store(f"sqlite:///{tmp_path / 'empty.db'}") as store:
            return await export(store, tmp_path / "empty.parquet", _ignore)

    assert asyncio.run(scenario()) == 0
    assert _imported(database_url, tmp_path / "empty.parquet") == Tally()


@pytest.mark.parametrize(
    ("column", "values", "message"),
    [
        ("id", ["../etc", "1" * 32], "not an id"),
        ("spec", ["{}", "{}"], "lacks"),
        ("theta", [[0.5] * SPEC.size] * 2, "damaged"),
        ("theta", [[float("nan")] * SPEC.size] * 2, "not finite"),
        ("theta", [None, None], "has no theta"),
        ("digest", ["0" * 64, None], "damaged"),
        ("members", [["x"], []], "not an id"),
        ("kind", ["composed", "composed"], "members"),
        ("kind", ["nonsense", "nonsense"], "kind"),
        ("model", [None, None], "model"),
        ("label", ["x" * 81, None], "limit is 80"),
        ("photo", [b"<svg>", None], "no WebP"),
        ("created_at", [None, None], "cannot be read"),
    ],
)
def test_import_of_a_faulty_row_names_the_fault(
    tmp_path: Path, database_url: str, column: str, values: list[Any], message: str
) -> None:
    path = _changed(_exported(tmp_path, mixed=False), column, values)
    with pytest.raises(HofError, match=message) as caught:
        _imported(database_url, path)
    assert str(caught.value).startswith(f"{path}: ")


def test_import_of_a_table_of_something_else_names_the_missing_columns(tmp_path: Path, database_url: str) -> None:
    pq.write_table(pa.table({"a": [1, 2]}), tmp_path / "other.parquet")
    with pytest.raises(CorruptWeights, match=r"columns id, kind, .* are missing"):
        _imported(database_url, tmp_path / "other.parquet")


@pytest.mark.parametrize("damage", ["empty", "text", "truncated", "flipped"])
def test_import_of_a_damaged_file_is_refused(tmp_path: Path, database_url: str, damage: str) -> None:
    path = _exported(tmp_path, mixed=False)
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 0xFF
    whole = path.read_bytes()
    path.write_bytes({"empty": b"", "text": b"hello", "truncated": whole[:-9], "flipped": bytes(data)}[damage])
    with pytest.raises(CorruptWeights):
        _imported(database_url, path)


def test_import_of_an_object_twice_in_a_file_puts_it_once(tmp_path: Path, database_url: str) -> None:
    path = _exported(tmp_path, mixed=False)
    table = pq.read_table(path)
    pq.write_table(pa.concat_tables([table, table]), path)
    assert _imported(database_url, path) == Tally(copied=2, present=2)


def test_import_of_a_missing_file_names_it(tmp_path: Path, database_url: str) -> None:
    with pytest.raises(FileNotFoundError, match=r"missing\.parquet"):
        _imported(database_url, tmp_path / "missing.parquet")


def test_import_of_a_word_without_its_objects_is_refused(tmp_path: Path, database_url: str) -> None:
    path = _exported(tmp_path)
    table = pq.read_table(path)
    pq.write_table(table.slice(table.num_rows - 1), path)
    with pytest.raises(NotFound, match="no longer exists"):
        _imported(database_url, path)
