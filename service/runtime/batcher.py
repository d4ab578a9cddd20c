"""Batching: images that wait at the same time share one call of the encoder.

No image waits for others to arrive: a call takes all images that wait when a worker thread begins it, and images that
arrive meanwhile go into the next call. There is no loop that could die: adding an image starts a call unless one is
on its way, and a call that ends starts the next.
"""

import asyncio
import time
from collections import deque
from collections.abc import Awaitable, Callable, Iterable
from typing import Final

import numpy as np

from service.encoding.encoder import Encoded
from service.mapping.spec import Array

MAX_BATCH: Final = 8  # images in one call; benchmarks/LOAD.md has the gain by size

Waiting = tuple[Array, "asyncio.Future[Encoded]"]  # an image and the future for its functions
Outcome = Encoded | Exception
Run = Callable[[Callable[[], list[Outcome]]], Awaitable[list[Outcome]]]


class Batcher:
    """An encoder shared by concurrent requests; one call at a time, which has all of the encoder's threads.

    Parameters
    ----------
    encode : (b, 3, size, size) -> the functions of each image, as `Encoder.encode`.
    run : calls a function on a worker thread.

    Attributes
    ----------
    images, calls : number of images that were encoded or failed, and of calls for them; an image whose client left
        before its turn counts in neither.
    answered_at : time of the last successful call, `time.monotonic()`.
    """

    def __init__(self, encode: Callable[[Array], Iterable[Encoded]], run: Run) -> None:
        self._encode = encode
        self._run = run
        self._waiting: deque[Waiting] = deque()
        self._calling: asyncio.Task[None] | None = None
        self.images = self.calls = 0
        self.answered_at = time.monotonic()

    async def encode(self, image: Array) -> Encoded:
        """Return the functions of one image, (1, 3, size, size). Raises as the encoder does for this image alone.

        If canceled before a call takes the image, the image is never encoded.
        """
        future: asyncio.Future[Encoded] = asyncio.get_running_loop().create_future()
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
        except BaseException as error:  # the service stops: the executor refuses the call, or this task is canceled
            unanswered = [*batch, *self._waiting]
            self._waiting.clear()
            _settle(unanswered, [error] * len(unanswered))
            if not isinstance(error, Exception):
                raise
        else:
            _settle(batch, outcomes)
        finally:
            self._calling = None
            self._start()

    def _take_and_encode(self, batch: list[Waiting]) -> list[Outcome]:
        """Move up to MAX_BATCH waiting images into the batch and encode them, without those whose client left.

        Runs on a worker thread.
        """
        while self._waiting and len(batch) < MAX_BATCH:
            waiting = self._waiting.popleft()
            if not waiting[1].done():
                batch.append(waiting)
        self.images += len(batch)
        return self._outcomes([image for image, _ in batch])

    def _outcomes(self, images: list[Array]) -> list[Outcome]:
        """Return the functions or the error of each image; if a call for several fails, encode each image alone."""
        if not images:
            return []
        self.calls += 1
        try:
            encoded = self._encode(np.concatenate(images))
            outcomes: list[Outcome] = [functions for _, functions in zip(images, encoded, strict=True)]
        except Exception as error:  # any error goes to the request of the image
            return [error] if len(images) == 1 else [self._outcomes([image])[0] for image in images]
        self.answered_at = time.monotonic()
        return outcomes


def _settle(batch: Iterable[Waiting], outcomes: Iterable[Encoded | BaseException]) -> None:
    """Set the outcome of each future, except for those whose client left."""
    for (_, future), outcome in zip(batch, outcomes, strict=True):
        if future.done():
            continue
        if isinstance(outcome, Exception):
            future.set_exception(outcome)
        elif isinstance(outcome, BaseException):
            future.cancel()
        else:
            future.set_result(outcome)
