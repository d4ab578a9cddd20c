"""Gates: bounds on the work that the service accepts. Work over a bound is refused at once with 429, not queued."""

import asyncio
import math
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Final, NoReturn

from service.errors import HofError, Overloaded
from service.settings import Settings

PACE_WEIGHT: Final = 0.05  # of the latest completion, in the moving average of the pace
MAX_RETRY_S: Final = 60
SHARE: Final = 3  # a client may hold this many times the room that is left: three quarters of a gate if it is alone
LARGEST: Final = 0.75  # of the limit on points: what a request counts for at most


class ClientLeft(Exception):
    """The client disconnected: nobody waits for this work any more."""


class Gate:
    """Admit work of one kind as long as all admitted work stays within a limit; an empty gate admits any amount.

    A client that is named, by its address or network, leaves room for others: see SHARE. The more clients, the less
    each may hold.

    For one event loop, not for several threads.

    Parameters
    ----------
    largest : what a request counts for at most, so that one that is larger than the limit finds room beside small
        ones, and leaves them some; None for no bound.

    Attributes
    ----------
    held : amount of work inside, in the unit of the gate.
    finished, cancelled, failed : number of requests that were answered, whose client left, or that failed by our
        fault.
    refused : number of requests that were refused.
    """

    def __init__(self, unit: str, limit: int, largest: int | None = None) -> None:
        self._unit = unit
        self._limit = limit
        self._largest = largest
        self._last_left = 0.0  # time.monotonic()
        self._pace_s = 0.0  # seconds for each unit of work while the gate is busy: a moving average
        self._held_by: Counter[str] = Counter()  # by client
        self.held = 0
        self.finished = self.cancelled = self.failed = self.refused = 0

    def charge(self, amount: int) -> int:
        """Return what an amount of work counts for."""
        return amount if self._largest is None else min(amount, self._largest)

    def refuse_if_full(self, amount: int = 1, client: str | None = None, *, own: int = 0) -> None:
        """Raise Overloaded if this amount of work would not be admitted now, in place of `own` that is inside."""
        others = self.held - own
        if not others:
            return
        if others + amount > self._limit:
            self._refuse(
                f"the service works on its limit of {self._limit} {self._unit}: repeat the call after Retry-After"
            )
        if client is not None and self._held_by[client] - own + amount > SHARE * (self._limit - self.held):
            self._refuse(
                f"this address or its network has its share of the service's {self._limit} {self._unit}: repeat the "
                "call after Retry-After, or send fewer at once"
            )

    @contextmanager
    def admit(self, amount: int = 1, client: str | None = None) -> Iterator["Admitted"]:
        """Hold an amount of work until the block ends. Raises Overloaded."""
        admitted = Admitted(self, client)
        if not self.held:
            self._last_left = time.monotonic()
        admitted.grow_to(amount)
        try:
            yield admitted
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
            self._release(admitted)

    def _refuse(self, detail: str) -> NoReturn:
        self.refused += 1
        raise Overloaded(detail, retry_after_s=self._drain_s())

    def take(self, amount: int, client: str | None) -> None:
        """Count an amount of work, without a check. `Admitted` calls this."""
        self.held += amount
        if client is not None:
            self._held_by[client] += amount
            if not self._held_by[client]:
                del self._held_by[client]

    def _release(self, admitted: "Admitted") -> None:
        now = time.monotonic()
        self._pace_s += PACE_WEIGHT * ((now - self._last_left) / max(1, admitted.amount) - self._pace_s)
        self._last_left = now
        self.take(-admitted.amount, admitted.client)

    def _drain_s(self) -> int:
        """Estimate seconds until current work drains, from the recent completion rate."""
        return min(max(1, math.ceil(self.held * self._pace_s)), MAX_RETRY_S)


class Admitted:
    """Work of one request inside a gate.

    Attributes
    ----------
    amount : the work, in the unit of the gate.
    client : address or network of the client; None for work without one.
    """

    def __init__(self, gate: Gate, client: str | None) -> None:
        self._gate = gate
        self.client: Final = client
        self.amount = 0

    def check(self, amount: int) -> None:
        """Raise Overloaded if `grow_to` would do so now."""
        self._gate.refuse_if_full(self._gate.charge(amount), self.client, own=self.amount)

    def grow_to(self, amount: int) -> None:
        """Hold a larger amount. Raises Overloaded; what it held so far it holds then, too."""
        self.check(amount)
        charge = self._gate.charge(amount)
        self._gate.take(charge - self.amount, self.client)
        self.amount = charge


@dataclass(frozen=True)
class Gates:
    """The gates of a service.

    images : images being received, queued or encoded.
    points : points being computed or sent, weighted by the size of their function; a stream counts its in-flight
        points only, and no request more than three quarters of the limit.
    uploads : bytes of request bodies that have arrived.
    answers : bytes of answers that are complete in memory and that their clients have not taken yet.
    """

    images: Gate
    points: Gate
    uploads: Gate
    answers: Gate

    @classmethod
    def of(cls, settings: Settings) -> "Gates":
        """Return empty gates with the limits of the settings."""
        points = settings.max_points_in_flight
        return cls(
            Gate("images at a time (--max-queued-images)", settings.max_queued_images),
            Gate("points at a time (--max-points-in-flight)", points, largest=math.ceil(LARGEST * points)),
            Gate("bytes of request bodies at a time (--max-upload-bytes)", settings.max_upload_bytes),
            Gate("bytes of answers at a time (--max-answer-bytes)", settings.max_answer_bytes),
        )
