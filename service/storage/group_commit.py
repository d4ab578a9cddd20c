"""Group commit: writes that come while a transaction is on its way to the disk share the next one.

Most of what a small write costs is its commit: the file's pages, and the wait for the disk.
"""

import asyncio
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

from sqlalchemy import Connection

from service.errors import Overloaded, StoreUnavailable
from service.storage.faults import domain_error
from service.storage.transactions import R, Work


class Write(NamedTuple):
    """A write that waits for its transaction, and the future for its outcome."""

    work: Work[Any]
    outcome: "asyncio.Future[Any]"


class Outcome(NamedTuple):
    """The result of a write, or its error."""

    result: Any = None
    error: Exception | None = None


class GroupCommit:
    """A thread that writes, one transaction after the other; for one event loop.

    A write waits for the transaction before its own, never for other writes to come.

    Parameters
    ----------
    transact : calls a function in a transaction: on disk when it returns, undone if it raises.
    """

    def __init__(self, transact: Callable[[Work[Any]], Any]) -> None:
        self._transact = transact
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="sqlite-writer")
        self._waiting: list[Write] = []
        self._is_writing = False

    async def write(self, work: Work[R]) -> R:
        """Call a function in a transaction, which it may share: on disk when this returns, undone if it raises.

        If a group fails, each of its writes is repeated in a transaction of its own. Once waiting, a write completes
        even if the caller is canceled.
        """
        loop = asyncio.get_running_loop()
        outcome: asyncio.Future[R] = loop.create_future()
        self._waiting.append(Write(work, outcome))
        if not self._is_writing:
            self._is_writing = True
            loop.call_soon(self._start, loop)  # behind the tasks that are about to write, too
        return await outcome

    def close(self) -> None:
        """Wait for the transaction on its way; later writes are refused."""
        self._thread.shutdown()

    def _start(self, loop: asyncio.AbstractEventLoop) -> None:
        group, self._waiting = self._waiting, []
        try:
            self._thread.submit(self._run, group, loop)
        except RuntimeError as error:  # closed
            self._end(group, [Outcome(error=error)] * len(group), loop)

    def _run(self, group: Sequence[Write], loop: asyncio.AbstractEventLoop) -> None:
        outcomes = self._outcomes([write.work for write in group])
        loop.call_soon_threadsafe(self._end, group, outcomes, loop)

    def _outcomes(self, works: Sequence[Work[Any]]) -> list[Outcome]:
        """Write all in one transaction. If it fails, and not because of the whole file, write each in its own."""

        def write_all(connection: Connection) -> list[Outcome]:
            return [Outcome(work(connection)) for work in works]

        try:
            outcomes: list[Outcome] = self._transact(write_all)
        except Exception as error:
            # Writes to a file that is locked or lost would fail, and wait, one after the other.
            if len(works) == 1 or isinstance(domain_error(error), Overloaded | StoreUnavailable):
                return [Outcome(error=error)] * len(works)
            return [self._outcomes([work])[0] for work in works]
        return outcomes

    def _end(self, group: Sequence[Write], outcomes: Sequence[Outcome], loop: asyncio.AbstractEventLoop) -> None:
        """Settle the group's futures, except for those whose caller was canceled; start the next group."""
        for (_, future), (result, error) in zip(group, outcomes, strict=True):
            if future.done():
                continue
            if error is None:
                future.set_result(result)
            else:
                future.set_exception(error)
        self._is_writing = bool(self._waiting)
        if self._is_writing:
            self._start(loop)
