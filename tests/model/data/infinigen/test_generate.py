"""Generation of meshes by worker processes that hang, crash and answer nonsense. No Blender is needed."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections import namedtuple
from collections.abc import Iterator
from pathlib import Path

import pytest

from model import cli
from model.data.infinigen import environment, generate, kinds
from model.data.infinigen.generate import FAILURES, MOST_IN_A_ROW, PER_WORKER
from model.data.sources.listed import mesh_records
from model.data.sources.meshes import turn
from tests.support import ROOT
from tests.support.slow import until
from tests.support.small import fake_infinigen

FAKE = Path(fake_infinigen.__file__)
Usage = namedtuple("Usage", "total used free")


class Fake:
    """A folder of meshes and a worker whose behavior is set by object."""

    def __init__(self, root: Path) -> None:
        self.folder = root / "meshes"
        self._plan, self._starts = root / "plan.json", root / "starts.txt"
        self._starts.touch()
        self.behave()

    def behave(self, **behaviors: str) -> None:
        """Set what the worker does at `start`, or at an object, `at_3`."""
        plan = {name.removeprefix("at_"): behavior for name, behavior in behaviors.items()}
        self._plan.write_text(json.dumps(plan))

    @property
    def command(self) -> list[str | Path]:
        return [sys.executable, FAKE, self._plan, self._starts]

    @property
    def starts(self) -> int:
        """Return how many workers were started."""
        return len(self.process_ids)

    @property
    def process_ids(self) -> list[int]:
        """Return the ids of all workers."""
        return [int(line) for line in self._starts.read_text().splitlines()]

    def generate(self, count: int, limit_s: int = 2, processes: int = 1) -> dict[str, str]:
        return generate.generate(self.folder, count, self.command, limit_s, processes)

    @property
    def numbers(self) -> list[int]:
        """Return the numbers of the meshes."""
        return sorted(int(path.name.split("-")[0]) for path in self.folder.glob("*.glb"))


@pytest.fixture
def fake(tmp_path: Path) -> Fake:
    return Fake(tmp_path)


def test_generate_again_makes_what_is_missing_only(fake: Fake) -> None:
    assert fake.generate(3) == {}
    assert fake.numbers == [0, 1, 2]
    assert fake.starts == 1
    (fake.folder / "000001-half.part").write_bytes(b"glT")  # of a run that was killed
    next(fake.folder.glob("000002-*")).unlink()
    assert fake.generate(3) == {}
    assert fake.numbers == [0, 1, 2]
    assert fake.starts == 2
    assert fake.generate(3) == {}
    assert fake.starts == 2


def test_generate_lists_its_meshes_with_kind_license_and_front(fake: Fake) -> None:
    fake.generate(5)
    records = mesh_records(fake.folder)
    assert [record.category for record in records] == [kinds.kind_of(number).name for number in range(5)]
    assert [record.rotation for record in records] == [turn("y", kinds.kind_of(number).front) for number in range(5)]
    assert {record.license for record in records} == {"BSD-3-Clause"}
    assert {record.source for record in records} == {"Infinigen"}


@pytest.mark.parametrize(
    ("behavior", "reason"),
    [
        ("loop", "took more processor time than allowed"),
        ("sleep", "gave no answer for 2 s"),
        ("crash", "crashed (SIGSEGV)"),
        ("garbage", "answered b'Fra:1 Mem:22.49M\\n', which is no JSON object"),
        ("flood", f"answered b'{'x' * 40}', which is no JSON object"),
        ("list", "answered b'[]\\n', which is no JSON object"),
        ("error", "RuntimeError: the factory made no mesh"),
        ("nothing", "no mesh, the worker said {'triangles': 12}"),
    ],
)
@pytest.mark.slow
def test_generate_object_that_fails_is_noted_and_others_are_made(
    fake: Fake, behavior: str, reason: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if behavior == "sleep":
        monkeypatch.setattr(generate, "PATIENCE", 1)
    name = f"000001-{kinds.kind_of(1).name}"
    fake.behave(at_1=behavior)
    assert fake.generate(4) == {name: reason}
    assert fake.numbers == [0, 2, 3]
    assert json.loads((fake.folder / FAILURES).read_text()) == {name: reason}
    fake.behave()
    assert fake.generate(4) == {name: reason}  # not tried again
    assert fake.numbers == [0, 2, 3]


def test_generate_worker_is_replaced_after_its_share_and_after_each_loss(
    fake: Fake, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(generate, "PER_WORKER", 3)
    fake.generate(7)
    assert fake.starts == 3
    fake.behave(at_8="crash")
    fake.generate(10)
    assert fake.starts == 5
    assert PER_WORKER >= 10  # starting costs seconds


def test_generate_two_processes_make_each_object_once(fake: Fake, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(generate, "PER_WORKER", 4)
    fake.behave(at_5="crash")
    assert len(fake.generate(20, processes=2)) == 1
    assert fake.numbers == [number for number in range(20) if number != 5]
    assert fake.starts == 6


def test_generate_all_objects_fail_stops_and_forgets_them(fake: Fake) -> None:
    fake.behave(**{f"at_{number}": "error" for number in range(1, 100)})
    with pytest.raises(ChildProcessError, match=f"{MOST_IN_A_ROW} objects in a row failed.*the factory made no mesh"):
        fake.generate(100)
    assert json.loads((fake.folder / FAILURES).read_text()) == {}
    fake.behave()
    assert fake.generate(20) == {}
    assert fake.numbers == list(range(20))


def test_generate_worker_that_does_not_start_tells_why(fake: Fake) -> None:
    fake.behave(start="fail")
    with pytest.raises(ChildProcessError, match=r"did not start: it crashed\. no module named bpy"):
        fake.generate(3)
    assert fake.numbers == []


def test_generate_full_disk_stops_without_a_failure(fake: Fake, monkeypatch: pytest.MonkeyPatch) -> None:
    free: Iterator[int] = iter([10**12, 10**12, 10**6])  # before two objects, and after the second failed
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(0, 0, next(free)))
    fake.behave(at_1="error")
    with pytest.raises(OSError, match="less than 500 MB are free"):
        fake.generate(3)
    monkeypatch.undo()
    fake.behave()
    assert fake.generate(3) == {}
    assert fake.numbers == [0, 1, 2]


@pytest.fixture
def flags(fake: Fake, tmp_path: Path) -> list[str]:
    """Return the flags of a command whose environment has the fake worker for its Python."""
    python = tmp_path / "environment" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(f"#!/bin/sh\nexec {' '.join(map(str, fake.command))}\n")  # whatever its arguments
    python.chmod(0o755)
    (tmp_path / "environment" / environment.STAMP).write_text(
        "\n".join((*environment.ALONE, *environment.PACKAGES, ""))
    )
    return ["data", "infinigen", "--out", str(fake.folder), "--environment", str(tmp_path / "environment")]


def test_infinigen_command_prints_made_and_failed_by_kind(
    fake: Fake, flags: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    fake.behave(at_0="error")
    assert cli.main([*flags, "--count", "2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert f"{kinds.kind_of(0).name:<24}{0:>6} made{1:>6} failed" in lines
    assert lines[-1] == f"1 objects of 1 kinds, 1 failed: {fake.folder}"


def test_infinigen_command_interrupted_lists_what_it_made(fake: Fake, flags: list[str]) -> None:
    fake.behave(all="slow")
    with subprocess.Popen([sys.executable, "-m", "model.cli.main", *flags, "--count", "200"], cwd=ROOT) as process:
        try:
            until(lambda: len(fake.numbers) >= 3)
            process.send_signal(signal.SIGINT)
            assert process.wait(30) != 0
        finally:
            process.kill()
    records = mesh_records(fake.folder)
    assert [record.path for record in records] == sorted(fake.folder.glob("*.glb"))
    assert 3 <= len(records) < 200
    assert not (fake.folder / FAILURES).exists()
    (worker,) = fake.process_ids
    with pytest.raises(ProcessLookupError):
        os.kill(worker, 0)
