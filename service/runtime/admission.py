"""How much work is let in. What exceeds a bound is refused at once, with 429, rather than kept waiting."""

import asyncio
import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

from starlette.requests import ClientDisconnect

from service.errors import HofError, Overloaded
from service.settings import Settings

RECENT: Final = 0.05  # what the last request to leave weighs in the pace
LONGEST_RETRY_S: Final = 60


class Gate:
    """Lets in work of one kind as long as all that is in stays within a limit; into an empty one any work fits.

    For one event loop, not for several threads.

    Attributes
    ----------
    held : how much is in, in the kind's unit.
    finished, cancelled, failed : how many requests left answered, with their client gone, or by our fault.
    refused : how many were not let in.
    """

    def __init__(self, unit: str, limit: int) -> None:
        self._unit = unit
        self._limit = limit
        self._last_left = 0.0  # time.monotonic()
        self._pace_s = 0.0  # between two units that leave while there is work: the mean of recent ones
        self.held = 0
        self.finished = self.cancelled = self.failed = self.refused = 0

    def check(self, amount: int = 1) -> None:
        """Raises Overloaded where so much work would not be let in now."""
        if self.held and self.held + amount > self._limit:
            self.refused += 1
            detail = f"the service works on its limit of {self._limit} {self._unit}"
            raise Overloaded(detail, retry_after_s=self._retry_after_s())

    @contextmanager
    def admit(self, amount: int = 1) -> Iterator[None]:
        """Hold so much work, 1 or more, until the block ends. Raises Overloaded."""
        self.check(amount)
        if not self.held:
            self._last_left = time.monotonic()
        self.held += amount
        try:
            yield
        except (asyncio.CancelledError, ClientDisconnect):
            self.cancelled += 1
            raise
        except Exception as error:
            if isinstance(error, HofError) and error.status < 500:
                self.finished += 1
            else:
                self.failed += 1
            raise
        else:
            self.finished += 1
        finally:
            self._leave(amount)

    def _leave(self, amount: int) -> None:
        now = time.monotonic()
        self._pace_s += RECENT * ((now - self._last_left) / amount - self._pace_s)
        self._last_left = now
        self.held -= amount

    def _retry_after_s(self) -> int:
        """When all that is in will have left, at the pace of late."""
        return min(max(1, math.ceil(self.held * self._pace_s)), LONGEST_RETRY_S)


@dataclass(frozen=True)
class Gates:
    """The bounds of a service.

    images : photos that are being sent, wait, or are encoded.
    points : points being computed or sent; a stream counts for no more than it has at a time.
    uploads : bytes of request bodies.
    """

    images: Gate
    points: Gate
    uploads: Gate

    @classmethod
    def of(cls, settings: Settings) -> "Gates":
        """As the settings have it."""
        return cls(
            Gate("images at a time", settings.max_queued_images),
            Gate("points at a time", settings.max_points_in_flight),
            Gate("bytes of request bodies at a time", settings.max_upload_bytes),
        )
