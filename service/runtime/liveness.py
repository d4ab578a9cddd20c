"""Liveness of a part of the service: real work shows it, never a clock alone, and a probe never waits long."""

import asyncio
import time
from collections.abc import Callable, Coroutine
from typing import Any, Final

PROBE_TIMEOUT_S: Final = 1.0  # longest wait of a probe
FRESH_S: Final = 10.0  # time for which an answered request proves that the part works
MAX_SILENCE_S: Final = 30.0  # longest time that an awaited answer may take: longer than any queue


class LivenessProbe:
    """Ping a part that has answered no request lately; one ping at a time.

    Parameters
    ----------
    ping : does the least work that shows that the part works; raises if it fails.
    answered_at : returns when the part last answered a request, `time.monotonic()`.
    fresh_s : time for which an answered request proves that the part works; default: FRESH_S.
    max_silence_s : longest time that a busy part may take to answer; default: MAX_SILENCE_S.
    """

    def __init__(
        self,
        ping: Callable[[], Coroutine[Any, Any, object]],
        answered_at: Callable[[], float],
        *,
        fresh_s: float | None = None,
        max_silence_s: float | None = None,
    ) -> None:
        self._ping = ping
        self._answered_at = answered_at
        self._fresh_s = FRESH_S if fresh_s is None else fresh_s
        self._max_silence_s = MAX_SILENCE_S if max_silence_s is None else max_silence_s
        self._pinging: asyncio.Task[object] | None = None
        self._pinged_at = 0.0
        self._last_failed = False  # whether the last ping that ended failed

    async def is_alive(self) -> bool:
        """Return within PROBE_TIMEOUT_S whether the part works.

        A busy part has `max_silence_s` to answer, unless its last ping failed.
        """
        if time.monotonic() - self._answered_at() < self._fresh_s:
            return True
        if self._pinging is None or self._pinging.done():
            self._last_failed = self._pinging is not None and not _succeeded(self._pinging)
            self._pinging = asyncio.create_task(self._ping())
            self._pinged_at = time.monotonic()
        ping = self._pinging
        await asyncio.wait((ping,), timeout=PROBE_TIMEOUT_S)
        if ping.done():
            return _succeeded(ping)
        last_answer = max(self._pinged_at, self._answered_at())
        return not self._last_failed and time.monotonic() - last_answer < self._max_silence_s


def _succeeded(ping: asyncio.Task[object]) -> bool:
    return not ping.cancelled() and ping.exception() is None
