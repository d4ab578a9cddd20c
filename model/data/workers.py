"""Run one function over many records in isolated processes: a crash costs one record.

VTK has crashed whole processes on single meshes, so each slot owns a one-process pool that is replaced
when its process dies or takes too long.
"""

import multiprocessing
import queue
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Generic, TypeVar

from tqdm import tqdm

Job = TypeVar("Job")


@dataclass(frozen=True)
class Outcome(Generic[Job]):
    """A job that ended: `failure` says in a sentence why it did not succeed, or is None."""

    job: Job
    failure: str | None


def run_isolated(
    function: Callable[[Job], None], jobs: Iterable[Job], processes: int, timeout_s: float = 180
) -> Iterator[Outcome[Job]]:
    """Call `function(job)` for each job in `processes` processes; yield outcomes as they come.

    Parameters
    ----------
    function : importable by name, keeps its result itself; an exception is a failure of its job.
    timeout_s : after this the job has failed and its process is killed.
    """
    slots: queue.SimpleQueue[_Slot] = queue.SimpleQueue()
    for _ in range(processes):
        slots.put(_Slot())

    def work(job: Job) -> Outcome[Job]:
        slot = slots.get()
        try:
            return Outcome(job, slot.call(function, job, timeout_s))
        finally:
            slots.put(slot)

    try:
        with ThreadPoolExecutor(processes) as threads:
            futures: list[Future[Outcome[Job]]] = [threads.submit(work, job) for job in jobs]
            yield from (future.result() for future in as_completed(futures))
    finally:
        while not slots.empty():
            slots.get().close()


def run_told(
    function: Callable[[Job], None],
    jobs: Sequence[Job],
    name: Callable[[Job], str],
    processes: int,
    desc: str,
    unit: str,
) -> dict[str, str]:
    """As `run_isolated`, behind a bar that counts `unit`s and tells what fails as it does; name -> failure."""
    failures: dict[str, str] = {}
    for outcome in tqdm(run_isolated(function, jobs, processes), total=len(jobs), desc=desc, unit=unit):
        if outcome.failure:
            failures[name(outcome.job)] = outcome.failure
            tqdm.write(f"skipped {name(outcome.job)}: {outcome.failure}")
    return failures


class _Slot:
    """One worker process, replaced after a crash or a time-out."""

    def __init__(self) -> None:
        self._pool = self._fresh()

    @staticmethod
    def _fresh() -> ProcessPoolExecutor:
        return ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"))

    def call(self, function: Callable[[Job], None], job: Job, timeout_s: float) -> str | None:
        try:
            self._pool.submit(function, job).result(timeout_s)
        except BrokenProcessPool:
            self._pool = self._fresh()
            return "the worker process crashed"
        except TimeoutError:
            self._kill()
            self._pool = self._fresh()
            return f"took longer than {timeout_s:.0f} s"
        except Exception as error:  # any failure of one job is an outcome, not an end
            return f"{type(error).__name__}: {error}".splitlines()[0]
        return None

    def _kill(self) -> None:
        for process in list((self._pool._processes or {}).values()):
            process.kill()
        self.close()

    def close(self) -> None:
        self._pool.shutdown(wait=False, cancel_futures=True)
