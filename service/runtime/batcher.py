"""Images that wait at the same time share one call of the encoder.

Nothing waits for others to come: a call takes what there is when a worker thread begins it, and what comes meanwhile
is the next call's. There is no loop that could die: whoever adds an image starts a call unless one is on its way, and
a call that ends starts the next.
"""

import asyncio
import time
from collections import deque
from collections.abc import Awaitable, Callable, Iterable
from typing import Final

import numpy as np

from service.mapping.spec import Array, Functions

MAX_BATCH: Final = 8  # images of a call; benchmarks/LOAD.md has the gain by size

Waiting = tuple[Array, "asyncio.Future[Functions]"]  # an image, and where its functions go
Outcome = Functions | Exception
Run = Callable[[Callable[[], list[Outcome]]], Awaitable[list[Outcome]]]


class Batcher:
    """The encoder for many at once; one call at a time, which has all of its threads.

    Parameters
    ----------
    encode : (b, 3, size, size) -> the functions of each, as `Encoder.encode`.
    run : calls a function on a worker thread.

    Attributes
    ----------
    images, calls : how many images were encoded or failed to be, and in how many calls; a client that left before
        its turn is in neither.
    answered_at : when a call last gave a result, `time.monotonic()`.
    """

    def __init__(self, encode: Callable[[Array], Iterable[Functions]], run: Run) -> None:
        self._encode = encode
        self._run = run
        self._waiting: deque[Waiting] = deque()
        self._calling: asyncio.Task[None] | None = None
        self.images = self.calls = 0
        self.answered_at = time.monotonic()

    async def encode(self, image: Array) -> Functions:
        """The functions of one image, (1, 3, size, size). Raises as `encode` does for this image alone.

        Cancelled before a call has taken it, the image is never encoded.
        """
        future: asyncio.Future[Functions] = asyncio.get_running_loop().create_future()
        self._waiting.append((image, future))
        self._start()
        return await future

    def _start(self) -> None:
        if self._waiting and self._calling is None:
            self._calling = asyncio.create_task(self._call())

    async def _call(self) -> None:
        batch: list[Waiting] = []
        try:
            outcomes = await self._run(lambda: self._take_and_encode(batch))
        except BaseException as error:  # the service ends: no worker takes it, or this task is cancelled
            left = [*batch, *self._waiting]
            self._waiting.clear()
            _settle(left, [error] * len(left))
            if not isinstance(error, Exception):
                raise
        else:
            _settle(batch, outcomes)
        finally:
            self._calling = None
            self._start()

    def _take_and_encode(self, batch: list[Waiting]) -> list[Outcome]:
        """On a worker thread: move up to MAX_BATCH of the waiting into the batch, but for those whose client left,
        and encode them."""
        while self._waiting and len(batch) < MAX_BATCH:
            waiting = self._waiting.popleft()
            if not waiting[1].done():
                batch.append(waiting)
        self.images += len(batch)
        return self._outcomes([image for image, _ in batch])

    def _outcomes(self, images: list[Array]) -> list[Outcome]:
        """Each image's functions, or what went wrong with it: where a call fails, each is encoded alone."""
        if not images:
            return []
        self.calls += 1
        try:
            found = self._encode(np.concatenate(images))
            outcomes: list[Outcome] = [functions for _, functions in zip(images, found, strict=True)]
        except Exception as error:  # whatever it is, it is told to who asked
            return [error] if len(images) == 1 else [self._outcomes([image])[0] for image in images]
        self.answered_at = time.monotonic()
        return outcomes


def _settle(batch: Iterable[Waiting], outcomes: Iterable[Functions | BaseException]) -> None:
    """Tell each its outcome, but for those whose client left."""
    for (_, future), outcome in zip(batch, outcomes, strict=True):
        if future.done():
            continue
        if isinstance(outcome, Exception):
            future.set_exception(outcome)
        elif isinstance(outcome, BaseException):
            future.cancel()
        else:
            future.set_result(outcome)
