"""Complete objects from points: read a file of points or a mesh, normalize it, encode it."""

import asyncio
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np

from service.encoding.clouds import PointInput
from service.encoding.completion import choose, turned_inputs
from service.encoding.encoder import Encoded, Encoder
from service.formats.scans.read import read_points
from service.mapping.frame import Frame
from service.runtime.frames import with_box
from service.runtime.parts import Runtime
from service.storage.rows import Record


@dataclass(frozen=True)
class Placement:
    """The place of a completed object in the frame of the points that were sent.

    A point p of the object frame (`frame=object`, scale 1), turned about +Y by `turn` degrees, is p' there, and lies at
    `scale` p' + `center`.

    count : number of points that were sent; of a mesh, that were sampled from it.
    """

    center: tuple[float, float, float]
    scale: float
    turn: float
    count: int

    @classmethod
    def of(cls, sent: PointInput, box: Frame) -> "Placement":
        """Return the place of the object that fills `box` of its function's numbers, which are in the points' box."""
        middle = [(low + high) / 2 for low, high in zip(box.low, box.high, strict=True)]
        x, y, z = sent.place(np.array([middle]))[0].tolist()
        return cls((x, y, z), sent.scale * box.unit, sent.turn, sent.count)

    def __str__(self) -> str:
        x, y, z = self.center
        turned = f", turned about +Y by {self.turn:g} degrees," if self.turn else ""
        place = f"times {self.scale:.6g}, plus ({x:.6g}, {y:.6g}, {z:.6g})"
        return f"{self.count} points; the object frame{turned} {place}"


def point_inputs(data: bytes, encoder: Encoder) -> list[PointInput]:
    """Return the inputs that an encoder of points takes, one for each turn. Raises as `read_points`, `normalize` do."""
    return turned_inputs(read_points(data), encoder.count or 0)


async def complete(
    runtime: Runtime, encoder: Encoder, inputs: Sequence[PointInput]
) -> tuple[PointInput, Encoded, Frame]:
    """Return the input that fits best, the functions of its object, fitted to it, and the box that they fill."""
    batcher = runtime.batchers[encoder.name]
    encoded = await asyncio.gather(*(batcher.encode(sent.tensor) for sent in inputs))

    def finish() -> tuple[PointInput, Encoded, Frame]:
        sent, functions = choose(encoder.spec, inputs, encoded)
        return sent, *with_box(runtime, encoder.spec, functions)

    return await runtime.run(finish)


def points_record(object_id: str, encoder: Encoder, box: Frame, label: str | None) -> Record:
    """Return the record of a completed object, created now."""
    return Record(object_id, "encoded", encoder.name, encoder.spec, datetime.now(UTC), frame=box, label=label)
