"""Processes that encode photos: one that dies costs the photo that killed it its row, and nothing else.

pebble replaces a process that dies in a job. It gives the whole pool up if a process dies and no job is known to run:
an idle one that the kernel kills for its memory, or one that dies before the pool has heard which job it took. Then
another pool takes the unfinished jobs, and the first of them runs alone, so that a photo that kills each process that
takes it is found out.
"""

import multiprocessing
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from dataclasses import dataclass
from typing import Final

from pebble import ProcessExpired, ProcessPool

from service.runtime.bulk.photos import failed
from service.runtime.bulk.sources import chunks
from service.storage.transfer.table import Item

JOB_PHOTOS: Final = 8  # sent to a process at a time
JOBS_AHEAD: Final = 4  # for each process: one slow photo does not stop the others
PHOTO_TIMEOUT_S: Final = 60.0
START_TIMEOUT_S: Final = 60.0  # of a process, until it takes a job
POLL_S: Final = 1.0
KILLED: Final = "the process that encoded it was killed, perhaps because it needed too much memory"

Names = tuple[str, ...]
Encode = Callable[[Names], list[Item]]  # in a process: importable by name


def encoded(encode: Encode, sources: Iterable[str], processes: int) -> Generator[Item, None, None]:
    """Yield the row of each photo, in order; photos are taken a little ahead. Closing it early kills the processes.

    Raises
    ------
    ChildProcessError : every process dies, whatever it does.
    """
    with closing(_Jobs(encode, processes)) as jobs:
        for names in chunks(sources, JOB_PHOTOS):
            jobs.add(names)
            if len(jobs) > JOBS_AHEAD * processes:
                yield from jobs.pop()
        while len(jobs):
            yield from jobs.pop()


@dataclass(frozen=True)
class _Job:
    names: Names
    future: "Future[list[Item]]"

    @property
    def is_lost(self) -> bool:
        """Return whether its pool broke before it ended."""
        return not self.future.done() or isinstance(self.future.exception(), BrokenProcessPool)


class _Jobs:
    """Jobs of a pool, the earliest first."""

    def __init__(self, encode: Encode, processes: int) -> None:
        self._encode, self._processes = encode, processes
        self._pool = _Pool(processes)
        self._jobs: deque[_Job] = deque()

    def __len__(self) -> int:
        return len(self._jobs)

    def add(self, names: Names) -> None:
        """Schedule a job."""
        self._jobs.append(self._pool.schedule(self._encode, names))

    def pop(self) -> list[Item]:
        """Return the rows of the earliest job, once it has ended."""
        job = self._jobs.popleft()
        try:
            return self._pool.result(job)
        except BrokenProcessPool:
            self._renew()
        except TimeoutError as error:
            if len(job.names) == 1:
                return [_failed(job.names[0], error)]
        except ProcessExpired:  # killed by one of the photos, or from outside
            pass
        return _one_by_one(self._encode, job.names)

    def close(self) -> None:
        """Kill the processes."""
        self._pool.close()

    def _renew(self) -> None:
        """Let another pool take the jobs that this one leaves."""
        self._pool.close()
        self._pool = _Pool(self._processes)
        self._jobs = deque(self._pool.schedule(self._encode, job.names) if job.is_lost else job for job in self._jobs)


class _Pool:
    """A pool of processes; BrokenProcessPool is the only error that tells that it is broken."""

    def __init__(self, processes: int) -> None:
        self._pool = ProcessPool(processes, context=multiprocessing.get_context("spawn"))

    def schedule(self, encode: Encode, names: Names) -> _Job:
        """Schedule a job; its future tells if the pool is broken."""
        future: Future[list[Item]]
        try:
            future = self._pool.schedule(encode, (names,), timeout=PHOTO_TIMEOUT_S * len(names))
        except RuntimeError as error:  # BrokenProcessPool is one, too
            future = Future()
            future.set_exception(BrokenProcessPool(str(error)))
        return _Job(names, future)

    def result(self, job: _Job) -> list[Item]:
        """Return the result of the earliest job.

        A broken pool leaves jobs undone that it has not sent to a process, and so does a process that dies holding the
        lock of the jobs' pipe. Hence the two limits.
        """
        deadline = time.monotonic() + START_TIMEOUT_S + PHOTO_TIMEOUT_S * max(1, len(job.names))
        while not wait([job.future], POLL_S).done:
            is_over = time.monotonic() > deadline or not self._pool.active
            if is_over and not wait([job.future], POLL_S).done:
                raise BrokenProcessPool("the pool has lost the job")
        return job.future.result()

    def close(self) -> None:
        """Kill the processes."""
        self._pool.stop()  # type: ignore[no-untyped-call]
        self._pool.join()


def _one_by_one(encode: Encode, names: Names) -> list[Item]:
    """Return the rows of photos, each in a job of its own, in a process that has no other jobs."""
    pool, rows = _Pool(1), list[Item]()
    try:
        for name in names:
            try:
                rows += pool.result(pool.schedule(encode, (name,)))
            except TimeoutError as error:
                rows.append(_failed(name, error))
            except (ProcessExpired, BrokenProcessPool) as error:
                pool.close()
                pool = _Pool(1)
                _check(pool, encode)
                rows.append(_failed(name, error))
    finally:
        pool.close()
    return rows


def _check(pool: _Pool, encode: Encode) -> None:
    """Raise ChildProcessError if a process dies even without photos."""
    try:
        pool.result(pool.schedule(encode, ()))
    except (ProcessExpired, BrokenProcessPool) as error:
        raise ChildProcessError(
            "the processes that encode photos die as they start, perhaps because memory is short: use fewer "
            "(--processes), and run the same command to continue"
        ) from error


def _failed(name: str, error: Exception) -> Item:
    """Return the row of a photo whose process was killed."""
    slow = f"encoding took longer than {PHOTO_TIMEOUT_S:.0f} s"
    return failed(name, slow if isinstance(error, TimeoutError) else KILLED)
