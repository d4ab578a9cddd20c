"""Many photos become a table: rows of good and bad photos, killed processes, continued runs."""

import os
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from service.errors import InvalidParameter
from service.runtime.bulk import encoding, workers
from service.runtime.bulk.encoding import encode_many
from service.runtime.bulk.photos import Setup, encode_photos
from service.runtime.bulk.sources import photos_of
from tests.support.photos import disc, image_file
from tests.support.small import model as tiny_model
from tests.support.small.slow_photos import encode_or_die, encode_or_wait

COLORS = ("red", "green", "blue", "black", "purple", "navy")
BAD = ("cut.png", "text.jpg", "white.png")


class Stopped(Exception):
    """Raised by a progress function, as Ctrl-C would."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder of six photos and three files without an object."""
    folder = tmp_path / "photos"
    folder.mkdir()
    for number, color in enumerate(COLORS):
        (folder / f"{number}.png").write_bytes(image_file(disc(color)))
    (folder / "cut.png").write_bytes(image_file(disc("red"))[:100])
    (folder / "text.jpg").write_text("hello")
    (folder / "white.png").write_bytes(image_file(disc("white")))
    return folder


@pytest.fixture
def setup(model_path: Path) -> Setup:
    """Return options of a run with the tiny model."""
    return Setup(model_path, None, "auto", None, 200_000, 1_000_000)


def _run(setup: Setup, folder: Path, path: Path, processes: int = 1) -> tuple[tuple[int, int], list[tuple[int, int]]]:
    """Encode a folder; return the counts, and what the progress function got."""
    reports: list[tuple[int, int]] = []
    counts = encode_many(
        setup, partial(photos_of, str(folder)), path, processes, lambda *numbers: reports.append(numbers)
    )
    return counts, reports


def _stop(setup: Setup, folder: Path, path: Path, limit: int) -> None:
    """Encode a folder, and stop after `limit` photos."""

    def progress(done: int, _total: int) -> None:
        if done == limit:
            raise Stopped

    with pytest.raises(Stopped):
        encode_many(setup, partial(photos_of, str(folder)), path, 1, progress)


def _table(path: Path) -> pa.Table:
    """Return the table without what differs between two runs."""
    return pq.read_table(path).drop_columns(["created_at"])


def _names(path: Path) -> list[str]:
    return [Path(source).name for source in pq.read_table(path)["source"].to_pylist()]


def test_a_photo_that_cannot_be_encoded_is_a_row_with_its_reason(setup: Setup, folder: Path, tmp_path: Path) -> None:
    counts, reports = _run(setup, folder, tmp_path / "t.parquet")
    assert counts == (6, 3)
    assert reports == [(done, 9) for done in range(1, 10)]
    assert _names(tmp_path / "t.parquet") == [*(f"{number}.png" for number in range(6)), *BAD]
    rows = pq.read_table(tmp_path / "t.parquet").to_pylist()
    assert [row["id"] is None for row in rows] == [False] * 6 + [True] * 3
    assert [row["error"] is None for row in rows] == [True] * 6 + [False] * 3
    assert "no object found" in rows[8]["error"]
    assert all(len(row["sha256"]) == 64 for row in rows)
    assert len(rows[0]["theta"]) == tiny_model.SPEC.size
    assert rows[0]["mask"] == "border"
    assert max(rows[0]["dimensions"]) == 1.0
    assert not list(tmp_path.glob("*.pieces"))


@pytest.mark.slow
def test_two_processes_write_the_rows_that_one_writes(
    setup: Setup, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "JOB_PHOTOS", 2)
    _run(setup, folder, tmp_path / "one.parquet")
    _run(setup, folder, tmp_path / "two.parquet", processes=2)
    assert _table(tmp_path / "one.parquet").equals(_table(tmp_path / "two.parquet"))


def test_files_that_cannot_be_read_or_are_too_large_are_rows(setup: Setup, tmp_path: Path) -> None:
    (tmp_path / "large.png").write_bytes(bytes(setup.max_bytes + 1))
    missing, large = encode_photos(setup, [str(tmp_path / "missing.png"), str(tmp_path / "large.png")])
    assert (missing.entry, missing.error, missing.sha256) == (None, "No such file or directory", None)
    assert large.error == "the photo has more than 200000 bytes, the limit (--max-image-bytes)"


def test_names_that_are_not_utf_8_are_escaped(setup: Setup, tmp_path: Path) -> None:
    name = os.fsdecode(os.fsencode(tmp_path) + b"/\xff.png")
    Path(name).write_bytes(image_file(disc("red")))
    (item,) = encode_photos(setup, [name])
    assert item.source == f"{tmp_path}/\\xff.png"
    assert item.entry


@pytest.mark.slow
def test_a_photo_that_kills_its_process_costs_its_own_row_only(
    setup: Setup, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(encoding, "encode_photos", encode_or_die)
    assert _run(setup, folder, tmp_path / "t.parquet")[0] == (5, 4)
    rows = pq.read_table(tmp_path / "t.parquet").to_pylist()
    assert [row["id"] is None for row in rows] == [False, False, True, False, False, False, True, True, True]
    assert rows[2]["error"].startswith("the process that encoded it was killed")


@pytest.mark.slow
def test_a_photo_that_takes_too_long_is_a_row(
    setup: Setup, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(encoding, "encode_photos", encode_or_wait)
    monkeypatch.setattr(workers, "JOB_PHOTOS", 1)
    monkeypatch.setattr(workers, "PHOTO_TIMEOUT_S", 10.0)
    assert _run(setup, folder, tmp_path / "t.parquet")[0] == (5, 4)
    rows = pq.read_table(tmp_path / "t.parquet").to_pylist()
    assert rows[2]["error"] == "encoding took longer than 10 s"


@pytest.mark.slow
def test_a_run_that_was_stopped_continues_after_its_last_piece(
    setup: Setup, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(encoding, "PIECE_ROWS", 2)
    path = tmp_path / "t.parquet"
    _stop(setup, folder, path, 5)
    assert not path.exists()
    pieces = sorted(piece.name for piece in (tmp_path / "t.parquet.pieces").glob("*.parquet"))
    assert pieces == ["00000000.parquet", "00000001.parquet"]
    assert _run(setup, folder, path) == ((6, 3), [(done, 9) for done in range(5, 10)])
    _run(setup, folder, tmp_path / "whole.parquet")
    assert _table(path).equals(_table(tmp_path / "whole.parquet"))


@pytest.mark.slow
def test_pieces_that_are_damaged_or_of_other_photos_are_written_again(
    setup: Setup, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(encoding, "PIECE_ROWS", 2)
    path = tmp_path / "t.parquet"
    _stop(setup, folder, path, 7)
    (tmp_path / "t.parquet.pieces" / "00000000.parquet").write_bytes(b"PAR1")
    (folder / "4.png").unlink()
    counts, reports = _run(setup, folder, path)
    assert counts == (5, 3)
    assert reports[0] == (3, 8)  # the second piece, and one new row
    assert _names(path) == sorted(photo.name for photo in folder.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("change", ["add", "remove"])
def test_photos_that_change_between_the_listings_end_the_run_and_it_continues(
    setup: Setup, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: str
) -> None:
    monkeypatch.setattr(encoding, "PIECE_ROWS", 2)
    path = tmp_path / "t.parquet"

    def photos() -> Iterator[str]:
        yield from photos_of(str(folder))
        if change == "add":
            (folder / "2a.png").write_bytes(image_file(disc("red")))
        else:
            (folder / "3.png").unlink(missing_ok=True)

    with pytest.raises(InvalidParameter, match="the photos changed while they were encoded"):
        encode_many(setup, photos, path, 1, lambda *_: None)
    assert not path.exists()
    assert [piece.name for piece in (tmp_path / "t.parquet.pieces").glob("*.parquet")] == ["00000000.parquet"]
    _run(setup, folder, path)
    assert _names(path) == sorted(photo.name for photo in folder.iterdir())


def test_a_run_with_other_options_is_not_continued(setup: Setup, folder: Path, tmp_path: Path) -> None:
    _stop(setup, folder, tmp_path / "t.parquet", 1)
    with pytest.raises(InvalidParameter, match="with another model or other options"):
        _run(replace(setup, background="keep"), folder, tmp_path / "t.parquet")


def test_a_table_that_exists_is_not_written_over(setup: Setup, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "t.parquet").write_text("mine")
    with pytest.raises(InvalidParameter, match="exists already"):
        _run(setup, folder, tmp_path / "t.parquet")
    assert (tmp_path / "t.parquet").read_text() == "mine"


def test_a_folder_without_photos_is_refused(setup: Setup, tmp_path: Path) -> None:
    with pytest.raises(InvalidParameter, match="there are no photos"):
        _run(setup, tmp_path, tmp_path / "t.parquet")
    assert not list(tmp_path.iterdir())


def test_photos_are_taken_only_a_little_ahead(setup: Setup, folder: Path) -> None:
    taken: list[str] = []

    def endless() -> Iterator[str]:
        while True:
            taken.append(str(folder / "0.png"))
            yield taken[-1]

    rows = workers.encoded(partial(encode_photos, setup), endless(), 1)
    for _ in range(100):
        assert next(rows).entry
    rows.close()
    assert len(taken) <= 100 + (workers.JOBS_AHEAD + 2) * workers.JOB_PHOTOS
