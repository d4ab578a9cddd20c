"""Run one function over many jobs in isolated processes: a crash costs one job.

VTK has crashed whole processes on single meshes. Pebble replaces a worker process that dies or takes too long.
"""

import multiprocessing
from collections import deque
from collections.abc import Callable, Generator, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, suppress
from dataclasses import dataclass
from typing import Final, Generic, TypeVar

from pebble import ProcessExpired, ProcessPool
from tqdm import tqdm

Job = TypeVar("Job")
JOBS_AHEAD: Final = 4  # for each process
POLL_S: Final = 1.0
CRASHED: Final = "the worker process crashed"


@dataclass(frozen=True)
class Outcome(Generic[Job]):
    """A job that ended.

    failure : the reason why it failed, in a sentence, or None.
    remark : what the function returned: a sentence on what it left out, or None.
    """

    job: Job
    failure: str | None
    remark: str | None = None


@dataclass(frozen=True)
class Report:
    """Sentences on jobs, by name: the reasons of those that failed, and remarks on others."""

    failures: dict[str, str]
    remarks: dict[str, str]


def run_isolated(
    function: Callable[[Job], str | None], jobs: Iterable[Job], processes: int, timeout_s: float = 180
) -> Generator[Outcome[Job], None, None]:
    """Call `function(job)` for each job in `processes` processes; yield outcomes in the order in which jobs end.

    Closing the generator early kills what still runs.

    Parameters
    ----------
    function : importable by name; stores its result itself, and may return a remark. An exception fails its job only.
    timeout_s : longest run of a job; after it the job fails and its process is killed.
    """
    remaining = list(jobs)
    while remaining:
        broken: list[Job] = []
        with closing(_ended(function, remaining, processes, timeout_s)) as ended:
            for job, future in ended:
                if isinstance(future.exception(), BrokenProcessPool):
                    broken.append(job)
                else:
                    failure = _failure(future, timeout_s)
                    yield Outcome(job, failure, None if failure else future.result())
        if len(broken) == len(remaining):  # not one ended, so the first has crashed
            yield Outcome(broken.pop(0), CRASHED)
        remaining = broken


def _ended(
    function: Callable[[Job], str | None], jobs: Sequence[Job], processes: int, timeout_s: float
) -> Generator[tuple[Job, "Future[str | None]"], None, None]:
    """Yield the jobs of a pool as they end; those that a broken pool leaves undone with BrokenProcessPool.

    A worker that dies before it has named its job breaks the pool.
    """
    pool = ProcessPool(processes, context=multiprocessing.get_context("spawn"))
    queue, running = deque(jobs), dict[Future[str | None], Job]()
    try:
        while queue or running:
            with suppress(RuntimeError):  # a broken pool takes no jobs
                while queue and len(running) < JOBS_AHEAD * processes:
                    running[pool.schedule(function, (queue[0],), timeout=timeout_s)] = queue[0]
                    queue.popleft()
            done = wait(running, POLL_S, FIRST_COMPLETED).done
            for future in [each for each in running if each in done]:
                yield running.pop(future), future
            if not done and not pool.active:
                break
        for job in (*running.values(), *queue):
            lost: Future[str | None] = Future()
            lost.set_exception(BrokenProcessPool("the pool broke before the job had begun"))
            yield job, lost
    finally:
        pool.stop()  # type: ignore[no-untyped-call]
        pool.join()


def run_with_report(
    function: Callable[[Job], str | None],
    jobs: Sequence[Job],
    name: Callable[[Job], str],
    processes: int,
    desc: str,
    unit: str,
) -> Report:
    """Call `run_isolated` behind a progress bar that also prints failures and remarks; return both."""
    report = Report({}, {})
    for outcome in tqdm(run_isolated(function, jobs, processes), total=len(jobs), desc=desc, unit=unit, disable=None):
        if outcome.failure:
            report.failures[name(outcome.job)] = outcome.failure
            tqdm.write(f"skipped {name(outcome.job)}: {outcome.failure}")
        if outcome.remark:
            report.remarks[name(outcome.job)] = outcome.remark
            tqdm.write(f"{name(outcome.job)}: {outcome.remark}")
    return report


def _failure(future: Future[str | None], timeout_s: float) -> str | None:
    """Return why a finished job failed, or None."""
    match future.exception():
        case None:
            return None
        case ProcessExpired():
            return CRASHED
        case TimeoutError():
            return f"took longer than {timeout_s:.0f} s"
        case error:
            return f"{type(error).__name__}: {error}".splitlines()[0]
