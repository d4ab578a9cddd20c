"""Calls on worker threads that their callers give up."""

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, cast

import pytest

from service.runtime.parts import Runtime

WAIT_S = 30


class _Metrics:
    def timed(self, function: Callable[[], object], _is_work: Callable[[object], bool]) -> Callable[[], object]:
        return function


def _runtime(executor: ThreadPoolExecutor) -> Runtime:
    nothing = cast(Any, None)
    return Runtime(nothing, nothing, nothing, nothing, executor, cast(Any, _Metrics()), nothing)


def test_run_stoppable_when_canceled_sets_the_event_and_waits_for_the_end() -> None:
    begun, ended = threading.Event(), threading.Event()

    def work(stop: threading.Event) -> None:
        begun.set()
        assert stop.wait(WAIT_S)
        ended.set()

    async def cancel() -> None:
        with ThreadPoolExecutor(1) as executor:
            task = asyncio.create_task(_runtime(executor).run_stoppable(work))
            await asyncio.to_thread(begun.wait, WAIT_S)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
            assert ended.is_set()

    asyncio.run(cancel())


def test_run_stoppable_returns_the_result() -> None:
    async def run() -> bool:
        with ThreadPoolExecutor(1) as executor:
            return await _runtime(executor).run_stoppable(threading.Event.is_set)

    assert asyncio.run(run()) is False
