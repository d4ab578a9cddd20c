"""Make meshes with Infinigen, one request to a worker process each; a second run goes on where the first stopped."""

import json
import shutil
import threading
from collections import deque
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from errno import ENOSPC
from pathlib import Path
from typing import Final

from tqdm import tqdm

from model.data.infinigen.kinds import KINDS, kind_of
from model.data.infinigen.worker_process import Worker, WorkerLost
from model.data.sources.listed import LIST
from service.files import whole_file

FAILURES: Final = "failures.json"  # name -> why there is no such mesh; it is not tried again
PER_WORKER: Final = 40  # objects after which a worker is replaced: its memory grows
PATIENCE: Final = 10  # seconds by the clock per second of processor time that an object may take
MOST_IN_A_ROW: Final = 12  # failures: more mean that the environment is at fault, not the objects
LEAST_FREE_BYTES: Final = 500_000_000
CREDITS: Final = {
    "source": "Infinigen",
    "author": "Infinigen, Princeton University",
    "license": "BSD-3-Clause",
    "page": "https://infinigen.org",
}


def generate(folder: Path, count: int, command: Sequence[str | Path], limit_s: int, processes: int) -> dict[str, str]:
    """Make the missing ones of `count` meshes, list all in the folder, and return name -> failure, of all runs.

    A mesh is named after its number and kind. Equal numbers give equal shapes; Blender's threads decide the order of
    vertices and their last digits.

    Parameters
    ----------
    command : starts `model.data.infinigen.worker` in its environment.
    limit_s : most processor time of an object.

    Raises
    ------
    OSError : the disk is almost full.
    ChildProcessError : the worker does not start, or MOST_IN_A_ROW objects fail one after the other.
    """
    folder.mkdir(parents=True, exist_ok=True)
    run = _Run(folder, command, limit_s)
    missing = run.missing(count)
    parts = [missing[start : start + PER_WORKER] for start in range(0, len(missing), PER_WORKER)]
    bar = tqdm(total=count, initial=count - len(missing), desc="infinigen", unit="object", disable=None)
    try:
        with bar, ThreadPoolExecutor(processes) as pool:
            futures = [pool.submit(run.make_part, part, bar) for part in parts]
            try:
                for future in as_completed(futures):
                    future.result()
            except BaseException:
                run.stop()
                pool.shutdown(wait=False, cancel_futures=True)
                raise
    finally:
        write_list(folder)
    return run.failures


class _Run:
    """One call of `generate`; its methods are called by several threads."""

    def __init__(self, folder: Path, command: Sequence[str | Path], limit_s: int) -> None:
        self._folder, self._command, self._limit_s = folder, command, limit_s
        path = folder / FAILURES
        self.failures: dict[str, str] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
        self._in_a_row: list[str] = []
        self._stopped = threading.Event()
        self._lock = threading.Lock()

    def missing(self, count: int) -> list[int]:
        """Return the numbers below `count` that were neither made nor failed."""
        names = [*self.failures, *(path.name for path in self._folder.glob("*.glb"))]
        finished = {int(name.split("-")[0]) for name in names}
        return [number for number in range(count) if number not in finished]

    def stop(self) -> None:
        """Make no more objects than those under way."""
        self._stopped.set()

    def make_part(self, numbers: Sequence[int], bar: tqdm) -> None:
        """Make objects with one worker, and another one where it is lost."""
        rest = deque(numbers)
        write_list(self._folder)  # what a run that was killed left is usable too
        while rest and not self._stopped.is_set():
            with Worker(self._command) as worker:
                is_lost = False
                while rest and not is_lost and not self._stopped.is_set():
                    is_lost = self._make(worker, rest.popleft())
                    bar.update()

    def _make(self, worker: Worker, number: int) -> bool:
        """Make one object, or note why not; return whether the worker is lost."""
        self._check_space()
        kind = kind_of(number)
        name = f"{number:06d}-{kind.name}"
        file = self._folder / f"{name}.glb"
        request = {"factory": kind.factory, "seed": number, "file": str(file), "limit_s": self._limit_s}
        try:
            answer = worker.ask(request, PATIENCE * self._limit_s)
        except WorkerLost as lost:
            self._note(name, str(lost))
            return True
        self._note(name, None if file.is_file() else str(answer.get("error", f"no mesh, the worker said {answer}")))
        return False

    def _check_space(self) -> None:
        if shutil.disk_usage(self._folder).free < LEAST_FREE_BYTES:
            raise OSError(
                ENOSPC,
                f"less than {LEAST_FREE_BYTES / 1e6:.0f} MB are free: make room and run again",
                str(self._folder),
            )

    def _note(self, name: str, failure: str | None) -> None:
        """Store a failure; raise an error if too many follow each other, and forget those."""
        with self._lock:
            if failure is None:
                self._in_a_row.clear()
                return
            self._check_space()  # the object may be right and the disk full
            tqdm.write(f"skipped {name}: {failure}")
            self.failures[name] = failure
            self._in_a_row.append(name)
            is_broken = len(self._in_a_row) >= MOST_IN_A_ROW
            if is_broken:
                for each in self._in_a_row:
                    self.failures.pop(each, None)
            with whole_file(self._folder / FAILURES) as file:
                file.write((json.dumps(self.failures, indent=1) + "\n").encode())
            if is_broken:
                raise ChildProcessError(f"{MOST_IN_A_ROW} objects in a row failed, {name} for the reason: {failure}")


def write_list(folder: Path) -> None:
    """Write the list that `hof-model data build` and `make` read, of all meshes in the folder."""
    fronts = {kind.name: kind.front for kind in KINDS}
    with whole_file(folder / LIST) as file:
        for path in sorted(folder.glob("*.glb")):
            kind = path.stem.split("-", 1)[1]
            line = {"file": path.name, "title": kind, "category": kind, "front": fronts.get(kind, "z"), **CREDITS}
            file.write((json.dumps(line) + "\n").encode())


def worker_command(python: Path) -> list[str | Path]:
    """Return the command that starts the worker with the Python of its environment; `-I` keeps our packages out."""
    return [python, "-I", Path(__file__).with_name("worker.py")]
