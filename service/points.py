"""A cloud of an object's points: chunk by chunk, as a file or as a stream; never all at once."""

from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from dataclasses import replace
from itertools import chain
from typing import Any, Final

import numpy as np

from service.errors import InvalidParameter
from service.formats import PointFormat, write
from service.mapping import Array, MappingSpec
from service.sampler import sample

FIRST_CHUNK: Final = 4096  # points; small, so that the first byte comes soon
CHUNK: Final = 65_536

Run = Callable[..., Awaitable[Any]]


def check_size(fmt: PointFormat, n: int, max_points: int) -> None:
    """Refuse more points than the format or the service allows, with InvalidParameter."""
    if n > max_points:
        raise InvalidParameter(f"n is {n}, the limit of this service is {max_points}", field="n")
    if fmt.max_points is not None and n > fmt.max_points:
        raise InvalidParameter(f"n is {n}, {fmt.name} holds at most {fmt.max_points} points", field="n")


def cloud(
    spec: MappingSpec, theta: Array, n: int, *, seed: int = 0, offset: int = 0, scale: float = 1.0
) -> Iterator[Array]:
    """Points of the object f^k(X) (paper, eq. 4), object frame times `scale`: (m, 3) float32 chunks, n in all."""
    word = [theta] * spec.k
    first = min(n, FIRST_CHUNK)
    head = sample(spec, word, first, seed=seed, offset=offset, scale=scale)
    if n == first:
        return head
    rest = sample(spec, word, n - first, seed=seed, offset=offset + first, scale=scale, chunk=CHUNK)
    return chain(head, rest)


async def stream(fmt: PointFormat, n: int, chunks: Callable[[], Iterator[Array]], run: Run) -> AsyncIterator[bytes]:
    """A file of n points, piece by piece; `run` computes each on a worker thread.

    Between two pieces the event loop sees whether the client is still there, in the first pass of a
    format that needs bounds too. `chunks` is called twice then: memory stays flat.
    """
    if fmt.needs_bounds:
        fmt = _with_bounds(fmt, await _bounds(chunks(), run))
    async for piece in _each(write(fmt, n, chunks), run):
        yield piece


async def _bounds(chunks: Iterator[Array], run: Run) -> tuple[Array, Array]:
    low, high = np.full(3, np.inf, np.float32), np.full(3, -np.inf, np.float32)
    async for points in _each(chunks, run):
        low, high = np.minimum(low, points.min(axis=0)), np.maximum(high, points.max(axis=0))
    return low, high


def _with_bounds(fmt: PointFormat, bounds: tuple[Array, Array]) -> PointFormat:
    """The format for points whose bounds are known: it needs no pass of its own."""
    return replace(fmt, needs_bounds=False, head=lambda n, _: fmt.head(n, bounds))


async def _each(items: Iterator[Any], run: Run) -> AsyncIterator[Any]:
    """The items of an iterator whose `next` computes."""
    while (item := await run(next, items, None)) is not None:
        yield item
