"""Gates: bounds on the work that the service accepts. Work over a bound is refused at once with 429, not queued."""

import asyncio
import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final

from service.errors import HofError, Overloaded
from service.settings import Settings

PACE_WEIGHT: Final = 0.05  # of the latest completion, in the moving average of the pace
MAX_RETRY_S: Final = 60


class ClientLeft(Exception):
    """The client disconnected: nobody waits for this work any more."""


class Gate:
    """Admit work of one kind as long as all admitted work stays within a limit; an empty gate admits any amount.

    For one event loop, not for several threads.

    Attributes
    ----------
    held : amount of work inside, in the unit of the gate.
    finished, cancelled, failed : number of requests that were answered, whose client left, or that failed by our
        fault.
    refused : number of requests that were refused.
    """

    def __init__(self, unit: str, limit: int) -> None:
        self._unit = unit
        self._limit = limit
        self._last_left = 0.0  # time.monotonic()
        self._pace_s = 0.0  # seconds for each unit of work while the gate is busy: a moving average
        self.held = 0
        self.finished = self.cancelled = self.failed = self.refused = 0

    def refuse_if_full(self, amount: int = 1) -> None:
        """Raise Overloaded if this amount of work would not be admitted now."""
        if self.held and self.held + amount > self._limit:
            self.refused += 1
            detail = f"the service works on its limit of {self._limit} {self._unit}"
            raise Overloaded(detail, retry_after_s=self._drain_s())

    @contextmanager
    def admit(self, amount: int = 1) -> Iterator[None]:
        """Hold an amount of work, at least 1, until the block ends. Raises Overloaded."""
        self.refuse_if_full(amount)
        if not self.held:
            self._last_left = time.monotonic()
        self.held += amount
        try:
            yield
        except (asyncio.CancelledError, ClientLeft):
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
            self._release(amount)

    def _release(self, amount: int) -> None:
        now = time.monotonic()
        self._pace_s += PACE_WEIGHT * ((now - self._last_left) / amount - self._pace_s)
        self._last_left = now
        self.held -= amount

    def _drain_s(self) -> int:
        """Estimate seconds until current work drains, from the recent completion rate."""
        return min(max(1, math.ceil(self.held * self._pace_s)), MAX_RETRY_S)


@dataclass(frozen=True)
class Gates:
    """The gates of a service.

    images : images being received, queued or encoded.
    points : points being computed or sent, weighted by the size of their function; a stream counts its in-flight
        points only.
    uploads : bytes of request bodies.
    """

    images: Gate
    points: Gate
    uploads: Gate

    @classmethod
    def of(cls, settings: Settings) -> "Gates":
        """Return empty gates with the limits of the settings."""
        return cls(
            Gate("images at a time", settings.max_queued_images),
            Gate("points at a time", settings.max_points_in_flight),
            Gate("bytes of request bodies at a time", settings.max_upload_bytes),
        )
