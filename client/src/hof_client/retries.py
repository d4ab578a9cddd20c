"""Repeats of calls: when, how often, and how long to wait before."""

import random
import time
from dataclasses import dataclass

from hof_client.problems import ConnectionFailed, HofError, TimedOut, TryLater, Unreachable


@dataclass(frozen=True)
class Retry:
    """Limits on the repeats of a call.

    A call is repeated after 429 and 503 (and a proxy's 502 and 504), as `Retry-After` says; and after a connection
    that failed, unless the call deletes something and may have been carried out. Waiting too long for an answer
    (`TimedOut`) repeats nothing.

    Attributes
    ----------
    times : repeats at most; 0 for none.
    total_s : no repeat starts later than this after the call began.
    first_s, longest_s : the wait before the first repeat if the answer names none, doubled for each further one up to
        the longest. Half of it is random, so that clients do not return all at once.
    """

    times: int = 4
    total_s: float = 60.0
    first_s: float = 0.5
    longest_s: float = 8.0


class Attempts:
    """The attempts of one call.

    Parameters
    ----------
    is_repeatable : whether the call may be sent again if it is unknown whether it was carried out.
    """

    def __init__(self, retry: Retry, *, is_repeatable: bool = True) -> None:
        self._retry = retry
        self._is_repeatable = is_repeatable
        self._is_over = False
        self._repeats = 0
        self._start = time.monotonic()

    def wait_s(self, error: HofError) -> float:
        """Return the seconds to wait before the next attempt. Raises the error if there is to be none."""
        wait_s = self._backoff_s()
        if isinstance(error, TryLater) and error.retry_after_s is not None:
            wait_s = error.retry_after_s + min(wait_s, 1 + error.retry_after_s) / 2
        is_late = time.monotonic() + wait_s > self._start + self._retry.total_s
        if not self._may_help(error) or self._is_over or self._repeats >= self._retry.times or is_late:
            raise error
        self._repeats += 1
        return wait_s

    def end(self) -> None:
        """Allow no further attempt."""
        self._is_over = True

    def _may_help(self, error: HofError) -> bool:
        if isinstance(error, ConnectionFailed) and not isinstance(error, TimedOut):
            return self._is_repeatable or isinstance(error, Unreachable)
        return isinstance(error, TryLater)

    def _backoff_s(self) -> float:
        longest_s = min(self._retry.first_s * 2.0**self._repeats, self._retry.longest_s)
        return longest_s * (0.5 + 0.5 * random.random())  # noqa: S311 - no secret
