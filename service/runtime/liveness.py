"""Whether a part of the service still works: asked by real work, never by a clock alone, and never for long."""

import asyncio
import time
from collections.abc import Callable, Coroutine
from typing import Any, Final

PATIENCE_S: Final = 1.0  # that a probe waits
FRESH_S: Final = 10.0  # that an answer to a request stands for
SILENCE_S: Final = 30.0  # without any answer, one being awaited: longer than any queue


class Vital:
    """A part that is pinged where nothing else has shown lately that it answers; one ping at a time.

    Parameters
    ----------
    ping : asks the part for the least work that shows it; raises where it fails.
    answered_at : when the part last answered a request, `time.monotonic()`.
    """

    def __init__(self, ping: Callable[[], Coroutine[Any, Any, object]], answered_at: Callable[[], float]) -> None:
        self._ping = ping
        self._answered_at = answered_at
        self._pinging: asyncio.Task[object] | None = None
        self._asked_at = 0.0
        self._failed = False  # the last ping that ended

    async def works(self) -> bool:
        """Whether it answers, told within PATIENCE_S. A part that is only busy is given SILENCE_S, unless it
        failed the last time."""
        if time.monotonic() - self._answered_at() < FRESH_S:
            return True
        if self._pinging is None or self._pinging.done():
            self._failed = self._pinging is not None and not _is_well(self._pinging)
            self._pinging = asyncio.create_task(self._ping())
            self._asked_at = time.monotonic()
        ping = self._pinging
        await asyncio.wait((ping,), timeout=PATIENCE_S)
        if ping.done():
            return _is_well(ping)
        return not self._failed and time.monotonic() - self._asked_at < SILENCE_S


def _is_well(ping: asyncio.Task[object]) -> bool:
    return not ping.cancelled() and ping.exception() is None
