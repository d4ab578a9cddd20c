"""Batching: images that wait at the same time share one call of the encoder.

No image waits for photos to arrive. But photos that have arrived already, and are being framed or looked up, go first:
then one call takes all of them. Images that arrive during a call go into the next one. There is no loop that could die:
adding an image starts a call unless one is on its way, and a call that ends starts the next.
"""

import asyncio
import time
from collections import deque
from collections.abc import Awaitable, Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import islice
from typing import Any, Final, NamedTuple, TypeVar, cast

import numpy as np

from service.encoding.encoder import Encoded
from service.mapping.spec import Array

MAX_BATCH: Final = 8  # images in one call; benchmarks/LOAD.md has the gain by size
MAX_TURNS: Final = MAX_BATCH  # on a worker thread that a call gives up for photos that have arrived
MAX_WAIT_S: Final = 0.1  # for them, before the call takes the next turn

R = TypeVar("R")
Outcomes = list[Any]  # of each photo in a call: functions, then what `then` returned; or an exception


class Waiting(NamedTuple):
    """Images of one photo, what to do with their functions on the worker thread, and the future for the result."""

    images: Array
    then: Callable[[list[Encoded]], Any]
    future: "asyncio.Future[Any]"


Run = Callable[[Callable[[], Outcomes | None]], Awaitable[Outcomes | None]]  # a function that returns None has not run


class Batcher:
    """An encoder shared by concurrent requests; one call at a time, which has all of the encoder's threads.

    Parameters
    ----------
    encode : (b, 3, size, size) -> the functions of each image, as `Encoder.encode`.
    run : calls a function on a worker thread. None is the result of one that gave up its turn.
    threads : worker threads.

    Attributes
    ----------
    images, calls : number of images that were encoded or failed, and of calls for them; an image whose client left
        before its turn counts in neither.
    answered_at : time of the last successful call, `time.monotonic()`.
    """

    def __init__(self, encode: Callable[[Array], Iterable[Encoded]], run: Run, threads: int = 1) -> None:
        self._encode = encode
        self._run = run
        self._threads = threads
        self._waiting: deque[Waiting] = deque()
        self._calling: asyncio.Task[None] | None = None
        self._coming = 0  # photos being framed or looked up; changed on the event loop alone
        self.images = self.calls = 0
        self.answered_at = time.monotonic()

    async def encode(self, image: Array) -> Encoded:
        """Return the functions of one image, (1, 3, size, size). Raises as the encoder does for this image alone.

        If canceled before a call takes the image, the image is never encoded.
        """
        return await self.encode_then(image, lambda encoded: encoded[0])

    async def encode_then(self, images: Array, then: Callable[[list[Encoded]], R]) -> R:
        """Encode the images of one photo, (n, 3, size, size), in one call.

        Return what `then` returns for their functions, or raise its error. `then` runs on a worker thread, before the
        next call: all photos of a call are answered at once, and those that follow them share the next call, too.
        """
        future: asyncio.Future[Any] = asyncio.get_running_loop().create_future()
        self._waiting.append(Waiting(images, then, future))
        self._start()
        return cast(R, await future)

    @contextmanager
    def coming(self) -> Iterator[None]:
        """Count a photo that has arrived and may become an image of the next call. On the event loop alone."""
        self._coming += 1
        try:
            yield
        finally:
            self._coming -= 1

    def _start(self) -> None:
        if self._waiting and self._calling is None:
            self._calling = asyncio.create_task(self._call())

    async def _call(self) -> None:
        batch: list[Waiting] = []
        try:
            outcomes, turn, deadline = None, 0, time.monotonic() + MAX_WAIT_S
            while outcomes is None:
                is_last_turn = turn == MAX_TURNS or time.monotonic() > deadline
                outcomes = await self._run(partial(self._take_and_encode, batch, is_last_turn=is_last_turn))
                turn += 1
            if self._threads > 1:
                await asyncio.gather(*(self._run(finish) for finish in self._finishes(batch, outcomes)))
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

    def _finishes(self, batch: list[Waiting], outcomes: Outcomes) -> list[Callable[[], Outcomes]]:
        """Return jobs, one for each thread, that replace the functions of each photo by what its `then` returns."""

        def finish(first: int) -> Outcomes:
            for index in range(first, len(batch), self._threads):
                outcomes[index] = _result_of(batch[index], outcomes[index])
            return outcomes

        return [partial(finish, first) for first in range(min(self._threads, len(batch)))]

    def _take_and_encode(self, batch: list[Waiting], *, is_last_turn: bool) -> Outcomes | None:
        """Move photos of MAX_BATCH waiting images into the batch and encode them, without those whose client left.

        Runs on a worker thread. Returns None, and takes nothing, if photos that have arrived should go first.
        """
        # A copy: the event loop may add photos meanwhile.
        if self._coming and _count(tuple(self._waiting)) < MAX_BATCH and not is_last_turn:
            return None
        while self._waiting and (not batch or _count([*batch, self._waiting[0]]) <= MAX_BATCH):
            waiting = self._waiting.popleft()
            if not waiting.future.done():
                batch.append(waiting)
        self.images += _count(batch)
        outcomes = self._outcomes(batch)
        if self._threads == 1:  # now: another job would wait behind the photos that come
            for finish in self._finishes(batch, outcomes):
                finish()
        return outcomes

    def _outcomes(self, batch: list[Waiting]) -> Outcomes:
        """Return the functions or the error of each photo; if a call for several fails, encode each photo alone."""
        if not batch:
            return []
        self.calls += 1
        try:
            encoded = iter(self._encode(np.concatenate([waiting.images for waiting in batch])))
            outcomes = [list(islice(encoded, len(waiting.images))) for waiting in batch]
        except Exception as error:  # any error goes to the request of the photo
            return [error] if len(batch) == 1 else [self._outcomes([waiting])[0] for waiting in batch]
        self.answered_at = time.monotonic()
        return outcomes


def _count(photos: Iterable[Waiting]) -> int:
    """Return the number of images."""
    return sum(len(photo.images) for photo in photos)


def _result_of(waiting: Waiting, outcome: list[Encoded] | Exception) -> Any:  # noqa: ANN401 - whatever `then` returns
    """Return what `then` returns, or the error; nothing is computed for a client that left."""
    if isinstance(outcome, Exception) or waiting.future.done():
        return outcome
    try:
        return waiting.then(outcome)
    except Exception as error:  # goes to the request of the photo
        return error


def _settle(batch: Iterable[Waiting], outcomes: Iterable[object]) -> None:
    """Set the outcome of each future, except for those whose client left."""
    for waiting, outcome in zip(batch, outcomes, strict=True):
        future = waiting.future
        if future.done():
            continue
        if isinstance(outcome, Exception):
            future.set_exception(outcome)
        elif isinstance(outcome, BaseException):
            future.cancel()
        else:
            future.set_result(outcome)
