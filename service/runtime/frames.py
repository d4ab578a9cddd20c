"""Frames of objects that an older version of hof stored: measured when such an object is first read, then kept."""

from dataclasses import replace

from service.encoding.report import ImageReport
from service.errors import StoreFull
from service.mapping.box import PROBE_POINTS, measure
from service.mapping.frame import Frame
from service.runtime.cost import cost_of
from service.runtime.parts import Runtime
from service.storage.rows import Record


async def complete_record(
    runtime: Runtime, record: Record, image: ImageReport | None = None, *, client: str | None = None
) -> tuple[Record, Frame]:
    """Return the record with its frame, and the frame; measure and keep what the record lacks.

    Parameters
    ----------
    image : report on the object's photo, if the caller has it.
    client : address that the measuring counts for: see `Gate`.

    Raises
    ------
    NotFound : the object was deleted meanwhile.
    Overloaded : more points are computed than the service allows.
    CorruptWeights : the function's values exceed float32.
    """
    if record.frame and (record.image or not image):
        return record, record.frame
    frame = record.frame
    if frame is None:
        with runtime.gates.points.admit(PROBE_POINTS * cost_of(record.spec), client):
            _, functions = await runtime.store.get(record.id)
            frame = await runtime.run(measure, record.spec, functions.theta)
    try:
        record = await runtime.store.complete(record.id, frame, image)
    except StoreFull:  # measured again next time
        record = replace(record, frame=frame)
    return record, record.frame or frame
