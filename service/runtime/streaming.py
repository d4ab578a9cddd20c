"""A cloud of an object's points: part by part, as a file or as a stream; never all at once."""

import asyncio
import zlib
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Final, TypeVar

import numpy as np

from service.errors import InvalidParameter
from service.formats.points.registry import Part, PointFormat
from service.mapping.canonical import Sampling, check_range
from service.mapping.color import ColorSampler
from service.mapping.sampler import CHUNK, SCALES, Sampler
from service.mapping.spec import HOF_1, Array, Colors, Functions, MappingSpec, word_of

PROBE_POINTS: Final = 4096  # of a new object: that it can be sampled at all
FIRST_PART: Final = CHUNK // 16  # points; few, so that the first byte comes soon
PART: Final = CHUNK
UNIT: Final = 2 * HOF_1.size  # numbers that a point of the default model is multiplied with: its cost is 1
CHEAP: Final = 16  # costs up to which a cloud may have as many points as the service allows at all

Run = Callable[..., Awaitable[Any]]
Result = TypeVar("Result")


@dataclass(frozen=True)
class Cloud:
    """Which points of an object: all that decides their coordinates and their colours.

    Parameters
    ----------
    n, seed, offset, scale, sampling : as in `Sampler.points`.

    Raises
    ------
    InvalidParameter : n, seed or offset is out of range.
    """

    spec: MappingSpec
    functions: Functions
    n: int
    seed: int = 0
    offset: int = 0
    scale: float = 1.0
    sampling: Sampling = "uniform"

    def __post_init__(self) -> None:
        check_range(self.n, self.seed, self.offset, self.sampling)

    @cached_property
    def sampler(self) -> Sampler:
        """The object's functions, packed once for all parts."""
        return Sampler(self.spec, word_of(self.spec, self.functions.theta))

    @cached_property
    def color_sampler(self) -> ColorSampler:
        """What colours the object, packed once for all parts. Raises ValueError where nothing does."""
        if self.functions.color is None:
            raise ValueError("the object has no colour")
        return ColorSampler(self.functions.color)

    def parts(self) -> Iterator[Part]:
        """All points in order."""
        start, size = 0, FIRST_PART
        while start < self.n:
            yield start, min(size, self.n - start)
            start, size = start + size, PART

    def points(self, part: Part) -> Array:
        """Points of a part, (count, 3) float32, object frame times `scale` (paper, eq. 4)."""
        start, count = part
        offset = self.offset + start
        return self.sampler.points(count, seed=self.seed, offset=offset, scale=self.scale, sampling=self.sampling)

    def colors(self, part: Part) -> Colors:
        """Colours of a part's points, (count, 3) uint8, sRGB."""
        start, count = part
        return self.color_sampler.colors(count, seed=self.seed, offset=self.offset + start, sampling=self.sampling)


def check_finite(spec: MappingSpec, functions: Functions) -> None:
    """Sample some points of an object at the largest scale, and their colours.

    Raises
    ------
    CorruptWeights : they exceed float32.
    """
    cloud = Cloud(spec, functions, PROBE_POINTS, scale=SCALES[1])
    for part in cloud.parts():
        cloud.points(part)  # the sampler raises
        if functions.color:
            cloud.colors(part)


def cost_of(spec: MappingSpec, *functions: Functions) -> int:
    """What a point of an object takes, the colours of all its functions included, in points of the default model; at
    least 1."""
    colors = sum(each.color.weights.size for each in functions if each.color)
    return max(1, (spec.k * spec.size + colors) // UNIT)


def check_cost(n: int, cost: int, max_points: int, field: str) -> None:
    """Refuse more points of a large function than it may take time for, with InvalidParameter."""
    most = max_points * CHEAP // cost
    if n > most:
        detail = f"{field} asks for {n} points, the limit for a function as large as this object's is {most}"
        raise InvalidParameter(detail, field=field)


def check_size(fmt: PointFormat, n: int, max_points: int) -> None:
    """Refuse more points than the format or the service allows, with InvalidParameter."""
    if n > max_points:
        raise InvalidParameter(f"n is {n}, the limit of this service is {max_points}", field="n")
    if fmt.max_points is not None and n > fmt.max_points:
        raise InvalidParameter(f"n is {n}, {fmt.name} holds at most {fmt.max_points} points", field="n")


def in_flight(n: int, ahead: int) -> int:
    """How many points of n a stream has at a time, computed or being computed; a small one counts for a first part."""
    return min(max(n, FIRST_PART), (ahead + 1) * PART)


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
