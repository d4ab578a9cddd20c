"""A cloud as a stream of bytes: parts are computed on worker threads and sent in order, never all at once."""

import asyncio
import zlib
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from functools import partial
from typing import Any, TypeVar

import numpy as np

from service.formats.points.registry import PointFormat
from service.mapping.cloud import Cloud, Part
from service.mapping.spec import Array

Run = Callable[..., Awaitable[Any]]
Result = TypeVar("Result")


async def stream(fmt: PointFormat, cloud: Cloud, run: Run, ahead: int) -> AsyncIterator[bytes]:
    """The file of a cloud, piece by piece.

    `run` computes parts on worker threads, up to `ahead` of them at a time, so that a large cloud takes
    several cores and memory stays flat. Where the client leaves, parts not begun are dropped. A format
    that needs bounds is computed twice.
    """
    bounds = await _bounds(cloud, run, ahead) if fmt.needs_bounds else None
    yield fmt.head(cloud.n, bounds)
    for opening, body in fmt.passes:
        separator = opening
        async for piece in _in_order(partial(body, cloud), cloud.parts(), run, ahead):
            yield separator + piece
            separator = fmt.separator
    if tail := fmt.tail(cloud.n):
        yield tail


async def gzipped(pieces: AsyncIterator[bytes], run: Run) -> AsyncIterator[bytes]:
    """Compress a stream, at the fastest level: it must not become slower than the network it saves."""
    squeeze = zlib.compressobj(level=1, wbits=31)  # 31: with gzip's header
    async for piece in pieces:
        if squeezed := await run(squeeze.compress, piece):
            yield squeezed
    yield squeeze.flush()


async def _bounds(cloud: Cloud, run: Run, ahead: int) -> tuple[Array, Array]:
    """Smallest and largest coordinates, (3,) each."""

    def extremes(part: Part) -> tuple[Array, Array]:
        points = cloud.points(part)
        return points.min(axis=0), points.max(axis=0)

    low, high = np.full(3, np.inf, np.float32), np.full(3, -np.inf, np.float32)
    async for part_low, part_high in _in_order(extremes, cloud.parts(), run, ahead):
        low, high = np.minimum(low, part_low), np.maximum(high, part_high)
    return low, high


async def _in_order(
    function: Callable[[Part], Result], parts: Iterator[Part], run: Run, ahead: int
) -> AsyncIterator[Result]:
    """`function` of each part, in order, while up to `ahead` parts are being computed; the first is sent before
    others begin, which would take the processor from it."""
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
