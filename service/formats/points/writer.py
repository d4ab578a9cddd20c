"""Write a cloud as a file, in steps that anybody can run: in turn (`write`), or on threads (`runtime.streaming`)."""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, Generic, TypeVar

import numpy as np

from service.formats.points.registry import PointFormat, Source
from service.mapping.cloud import Part, bounds
from service.mapping.spec import Array

Result = TypeVar("Result")


@dataclass(frozen=True)
class Pass(Generic[Result]):
    """One run over all parts of a cloud.

    compute : part -> result; calls may run on any thread, several at a time.
    emit : result -> the next bytes of the file, maybe none; call it for one part after another, in their order.
    """

    compute: Callable[[Part], Result]
    emit: Callable[[Result], bytes]


def write(fmt: PointFormat, source: Source) -> Iterator[bytes]:
    """Return the file piece by piece: head, one piece for each part in each pass, tail; no piece is empty.

    Raises
    ------
    InvalidParameter : at once, if the source has no points or more than the format holds.
    """
    fmt.check_count(source.n)
    return filter(None, _in_turn(fmt, source))


def steps(fmt: PointFormat, source: Source) -> Iterator[bytes | Pass[Any]]:
    """Return the steps that write a file: bytes, maybe none, and passes. Finish a pass before you take the next step.

    A format that needs bounds takes one pass more, which emits nothing: points are computed again, never kept.
    """
    extremes: list[Array] = []

    def measure(part: Part) -> Array:
        return np.stack(bounds([source.points(part)]))  # (2, 3)

    def keep(corners: Array) -> bytes:
        extremes.append(corners)
        return b""

    if fmt.needs_bounds:
        yield Pass(measure, keep)
    yield fmt.head(source.n, bounds(extremes) if fmt.needs_bounds else None)
    for opening, body in fmt.passes:
        yield Pass(partial(body, source), _preceded_by(opening, fmt.separator))
    yield fmt.tail(source.n)


def _in_turn(fmt: PointFormat, source: Source) -> Iterator[bytes]:
    for step in steps(fmt, source):
        if isinstance(step, bytes):
            yield step
        else:
            yield from (step.emit(step.compute(part)) for part in source.parts())


def _preceded_by(opening: bytes, separator: bytes) -> Callable[[bytes], bytes]:
    """Return a function that puts `opening` before the first piece and `separator` before every other."""
    before = itertools.chain([opening], itertools.repeat(separator))
    return lambda piece: next(before) + piece
