"""Complete objects from points: read a file of points or a mesh, normalize it, encode it."""

from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial

from service.encoding.clouds import PointInput, normalize
from service.encoding.encoder import Encoded, Encoder
from service.formats.scans.read import read_points
from service.mapping.frame import Frame
from service.runtime.frames import with_box
from service.runtime.parts import Runtime
from service.storage.rows import Record


@dataclass(frozen=True)
class Placement:
    """The place of a completed object in the frame of the points that were sent.

    A point p of the object frame (`frame=object`, scale 1) is `scale` p + `center` there.

    count : number of points that were sent; of a mesh, that were sampled from it.
    """

    center: tuple[float, float, float]
    scale: float
    count: int

    @classmethod
    def of(cls, sent: PointInput, box: Frame) -> "Placement":
        """Return the place of the object that fills `box` of its function's numbers, which are in the points' box."""
        x, y, z = (
            middle + sent.scale * (low + high) / 2
            for middle, low, high in zip(sent.center, box.low, box.high, strict=True)
        )
        return cls((x, y, z), sent.scale * box.unit, sent.count)

    def __str__(self) -> str:
        x, y, z = self.center
        return f"{self.count} points; the object frame times {self.scale:.6g}, plus ({x:.6g}, {y:.6g}, {z:.6g})"


def point_input(data: bytes, encoder: Encoder) -> PointInput:
    """Return the input that an encoder of points takes. Raises as `read_points` and `normalize` do."""
    return normalize(read_points(data), encoder.count or 0)


async def complete(runtime: Runtime, encoder: Encoder, sent: PointInput) -> tuple[Encoded, Frame]:
    """Return the functions of the object that points are a part of, and the box that they fill."""
    return await runtime.batchers[encoder.name].encode_then(sent.tensor, partial(with_box, runtime, encoder.spec))


def points_record(object_id: str, encoder: Encoder, box: Frame, label: str | None) -> Record:
    """Return the record of a completed object, created now."""
    return Record(object_id, "encoded", encoder.name, encoder.spec, datetime.now(UTC), frame=box, label=label)
