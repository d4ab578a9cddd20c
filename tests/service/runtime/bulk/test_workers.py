"""Processes that die at any time, by a real SIGKILL, and the rows that come of it."""

import multiprocessing
import os
import signal
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from functools import partial
from multiprocessing import spawn
from pathlib import Path

import pytest

from service.runtime.bulk import workers
from service.runtime.bulk.photos import Setup, encode_photos
from service.runtime.bulk.workers import encoded
from tests.support.photos import disc, image_file
from tests.support.processes import START_TIMEOUT_S, dying_python
from tests.support.small.slow_photos import DeadlyModel, DeadlyName, encode_behind_gate


@pytest.fixture
def names(tmp_path: Path) -> list[str]:
    """Return the paths of six photos."""
    paths = [tmp_path / f"{number}.png" for number in range(6)]
    for path in paths:
        path.write_bytes(image_file(disc("red")))
    return [str(path) for path in paths]


@pytest.fixture
def setup(model_path: Path) -> Setup:
    return Setup(model_path, None, "auto", None, 200_000, 1_000_000)


@pytest.fixture
def encode(setup: Setup) -> workers.Encode:
    return partial(encode_photos, setup)


def _kill_all() -> None:
    processes = multiprocessing.active_children()
    assert processes
    for process in processes:
        if process.pid:
            os.kill(process.pid, signal.SIGKILL)
        process.join()


@pytest.mark.slow
@pytest.mark.parametrize("processes", [1, 2])
def test_encoded_with_idle_processes_killed_gives_every_row(
    encode: workers.Encode, names: list[str], processes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "JOB_PHOTOS", 1)
    monkeypatch.setattr(workers, "JOBS_AHEAD", 0)  # the processes are idle whenever a photo is taken

    def sources() -> Iterator[str]:
        for number, name in enumerate(names):
            if number in {2, 5}:
                _kill_all()
            yield name

    rows = list(encoded(encode, sources(), processes))
    assert [row.source for row in rows] == names
    assert all(row.entry for row in rows)


def _wait_for_files(folder: Path, pattern: str, count: int) -> None:
    deadline = time.monotonic() + START_TIMEOUT_S
    while len(list(folder.glob(pattern))) < count:
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.mark.slow
@pytest.mark.parametrize("job_photos", [1, 2])
def test_encoded_with_busy_processes_killed_gives_every_row(
    setup: Setup, names: list[str], job_photos: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "JOB_PHOTOS", job_photos)
    gate = tmp_path / "gate"
    gate.mkdir()
    with closing(encoded(partial(encode_behind_gate, gate, setup), names, 2)) as rows:
        first = next(rows)
        _wait_for_files(gate, "*.waits", 2)
        _kill_all()
        (gate / "open").touch()
        others = list(rows)
    assert [row.source for row in (first, *others)] == names
    assert all(row.entry for row in (first, *others))


@pytest.mark.slow
def test_encoded_with_a_photo_that_kills_each_process_before_it_names_the_job_costs_its_row_only(
    encode: workers.Encode, names: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "JOB_PHOTOS", 2)
    names[2] = DeadlyName(names[2])
    rows = list(encoded(encode, names, 1))
    assert [row.source for row in rows] == names
    assert [row.error for row in rows] == [None, None, workers.KILLED, None, None, None]


def test_encoded_with_processes_that_cannot_start_ends_with_an_error(
    encode: workers.Encode, names: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(spawn, "_python_exe", dying_python(tmp_path))
    with pytest.raises(ChildProcessError, match="die as they start"):
        list(encoded(encode, names, 2))
    assert not multiprocessing.active_children()


@pytest.mark.slow
@pytest.mark.parametrize("job_photos", [1, 8])
def test_encoded_with_processes_killed_as_they_load_the_model_ends_with_an_error(
    setup: Setup, names: list[str], job_photos: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(workers, "JOB_PHOTOS", job_photos)
    encode = partial(encode_photos, replace(setup, model=DeadlyModel(setup.model)))
    with pytest.raises(ChildProcessError, match="die as they start"):
        list(encoded(encode, names, 1))
    assert not multiprocessing.active_children()
