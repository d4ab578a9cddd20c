"""A cloud as a stream of bytes: parts are computed on worker threads and sent in order, never all at once."""

import asyncio
import zlib
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from typing import Any, TypeVar

from service.formats.points.registry import PointFormat
from service.formats.points.writer import steps
from service.mapping.cloud import Cloud, Part

Run = Callable[..., Awaitable[Any]]
Result = TypeVar("Result")


async def stream(fmt: PointFormat, cloud: Cloud, run: Run, ahead: int) -> AsyncIterator[bytes]:
    """Yield the file of a cloud piece by piece.

    `run` computes parts on worker threads, up to `ahead` at a time, so that a large cloud uses several cores and
    memory stays flat. If the client leaves, parts that have not started are dropped. For a format that needs bounds,
    all points are computed twice.
    """
    for step in steps(fmt, cloud):
        if isinstance(step, bytes):
            if step:
                yield step
            continue
        async for result in _in_order(step.compute, cloud.parts(), run, ahead):
            if piece := step.emit(result):
                yield piece


async def gzipped(pieces: AsyncIterator[bytes], run: Run) -> AsyncIterator[bytes]:
    """Compress a stream at the fastest level: compression must not be slower than the network."""
    squeeze = zlib.compressobj(level=1, wbits=31)  # 31: with gzip's header
    async for piece in pieces:
        if squeezed := await run(squeeze.compress, piece):
            yield squeezed
    yield squeeze.flush()


async def _in_order(
    function: Callable[[Part], Result], parts: Iterator[Part], run: Run, ahead: int
) -> AsyncIterator[Result]:
    """Yield `function` of each part, in order, while up to `ahead` parts are being computed.

    The first part is yielded before others start, so that they do not take the processor from it.
    """
    waiting: deque[asyncio.Task[Result]] = deque()
    try:
        for index, part in enumerate(parts):
            waiting.append(asyncio.ensure_future(run(function, part)))
            if index == 0 or len(waiting) >= ahead:
                yield await waiting.popleft()
        while waiting:
            yield await waiting.popleft()
    finally:
        for task in waiting:
            task.cancel()
