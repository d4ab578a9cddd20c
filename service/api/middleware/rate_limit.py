"""Rate limits: requests of each client in a sliding window, counted in this process."""

import math
import time
from typing import Final

from limits import RateLimitItem, parse
from limits.storage import MemoryStorage
from limits.strategies import SlidingWindowCounterRateLimiter


class RateLimit:
    """A limit on the requests of each client, for example `100/minute`.

    Attributes
    ----------
    amount, window_s : requests that a client may make in so many seconds.
    """

    def __init__(self, text: str) -> None:
        self._item: RateLimitItem = parse(text)
        self._limiter = SlidingWindowCounterRateLimiter(MemoryStorage())
        self.amount: Final = self._item.amount
        self.window_s: Final = self._item.get_expiry()

    def hit(self, client: str) -> bool:
        """Count a request and return whether it keeps the limit; one over the limit does not count."""
        return self._limiter.hit(self._item, client)

    def state(self, client: str) -> tuple[int, int]:
        """Return how many requests the client has left, and the seconds until it has another."""
        reset_at, remaining = self._limiter.get_window_stats(self._item, client)
        return remaining, max(1, math.ceil(reset_at - time.time()))
