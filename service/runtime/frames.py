"""Boxes and details of objects: measured for new ones, and completed where the records of older ones lack them."""

from dataclasses import replace
from typing import Final, TypeVar

from service.errors import StoreFull
from service.formats.rounding import rounded
from service.mapping.box import PROBE_POINTS, measure
from service.mapping.frame import Frame
from service.mapping.spec import Functions, MappingSpec
from service.runtime.cost import cost_of
from service.runtime.parts import Runtime
from service.storage.rows import Details, Record

NO_DETAILS: Final = Details()
F = TypeVar("F", bound=Functions)


def with_box(runtime: Runtime, spec: MappingSpec, functions: F) -> tuple[F, Frame]:
    """Return the functions of a new object, rounded as the store's setting says, and the box that they then fill.

    Runs on a worker thread.
    """
    kept = rounded(spec, functions, runtime.settings.store_dtype)
    return kept, measure(spec, kept.theta)


async def complete_record(
    runtime: Runtime, record: Record, details: Details = NO_DETAILS, *, client: str | None = None
) -> tuple[Record, Frame]:
    """Return the record with its frame, and the frame; measure and keep what the record lacks.

    Parameters
    ----------
    details : of the object's photo, if the caller has it.
    client : address that the measuring counts for: see `Gate`.

    Raises
    ------
    NotFound : the object was deleted meanwhile.
    Overloaded : more points are computed than the service allows.
    CorruptWeights : the function's values exceed float32.
    """
    missing = details.missing_in(record)
    if record.frame and not missing:
        return record, record.frame
    frame = record.frame
    if frame is None:
        with runtime.gates.points.admit(PROBE_POINTS * cost_of(record.spec), client):
            _, functions = await runtime.store.get(record.id)
            frame = await runtime.run(measure, record.spec, functions.theta)
    try:
        record = await runtime.store.complete(record.id, frame, missing)
    except StoreFull:  # measured again next time
        record = replace(record, frame=frame)
    return record, record.frame or frame
