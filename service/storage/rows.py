"""Rows of the table of objects: write a record and its functions, read them back."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from sqlalchemy import Connection, Row, bindparam, func, select

from service.encoding.estimates import Estimates
from service.encoding.report import ImageReport
from service.mapping.frame import Frame
from service.mapping.spec import CACHED_SPECS, Array, Color, Functions, MappingSpec, join_functions
from service.storage.database import objects, uses

Kind = Literal["encoded", "imported", "composed", "interpolated"]

HEADER: Final = [
    *(column for column in objects.columns if column.name not in ("theta", "color", "photo")),
    objects.c.photo.is_not(None).label("has_photo"),
]
WHOLE: Final = [*HEADER, objects.c.theta, objects.c.color]
ALL: Final = [*WHOLE, objects.c.photo]
ONE: Final = select(*WHOLE).where(objects.c.id == bindparam("of"))  # built once: every photo runs it
INSERT: Final = objects.insert()  # built once: every photo runs it
BEYOND_HALF: Final = np.uint32(0x1FFF)  # bits of a float32 that are zero if float16 holds it
BATCH_ROWS: Final = 512
BATCH_BYTES: Final = 16 * 2**20  # of functions and photos; one object may have more


@dataclass(frozen=True)
class Record:
    """An object without its functions.

    id : hexadecimal digest of the inputs (`service.storage.ids`).
    created_at : UTC.
    model : name of the model that produced its theta.
    members : ids of the objects it was made from: a composed object's word, an interpolated object's parents.
    color_spec : spec of its color function; None without color.
    frame : its box; None if an older version of hof stored it and nobody has read it since.
    image : report on the photo it was encoded from; None if there was none, or if an older version stored it.
    estimates : of the encoder; None if it makes none, or if the object was not encoded from a photo.
    label : the name that people gave it; None without one.
    has_photo : whether a thumbnail of its photo is kept.
    """

    id: str
    kind: Kind
    model: str
    spec: MappingSpec
    created_at: datetime
    members: tuple[str, ...] = ()
    color_spec: MappingSpec | None = None
    frame: Frame | None = None
    image: ImageReport | None = None
    estimates: Estimates | None = None
    label: str | None = None
    has_photo: bool = False


@dataclass(frozen=True)
class Details:
    """Details of an object that come with its photo, and that a stored object may lack.

    image : report on the photo.
    label : name of the object.
    photo : thumbnail of the photo, a file.
    """

    image: ImageReport | None = None
    label: str | None = None
    photo: bytes | None = None

    def missing_in(self, record: Record) -> dict[str, Any]:
        """Return the details that a record lacks, as values of columns."""
        values: dict[str, Any] = {}
        if self.image and not record.image:
            values["image"] = self.image.to_json()
        if self.label and not record.label:
            values["label"] = self.label
        if self.photo and not record.has_photo:
            values["photo"] = self.photo
        return values


class Entry(NamedTuple):
    """A row of the table: an object with its own functions.

    seq : its place in the list, from 1; 0 if it is not from a store.
    functions : None for a composed object, which has those of its members.
    photo : thumbnail of its photo, a file; None without one.
    """

    seq: int
    record: Record
    functions: Functions | None
    photo: bytes | None = None


def insert_all(
    connection: Connection, pairs: Sequence[tuple[Record, Functions | None]], photos: Mapping[str, bytes]
) -> None:
    """Insert objects, their photos' thumbnails by id and, of composed ones, the uses of their members."""
    for record, functions in pairs:
        _insert(connection, record, functions, photos.get(record.id))


def _insert(connection: Connection, record: Record, functions: Functions | None, photo: bytes | None) -> None:
    color = functions.color if functions else None
    values = {
        "id": record.id,
        "kind": record.kind,
        "created_at": record.created_at,
        "model": record.model,
        "spec": record.spec.to_json(),
        "members": " ".join(record.members),
        "theta": _bytes(functions.theta) if functions else None,
        "color": _bytes(color.weights) if color else None,
        "color_spec": record.color_spec.to_json() if record.color_spec else None,
        "frame": record.frame.to_bytes() if record.frame else None,
        "image": record.image.to_json() if record.image else None,
        "estimates": record.estimates.to_json() if record.estimates else None,
        "label": record.label,
        "photo": photo,
    }
    connection.execute(INSERT, values)
    if record.kind == "composed":
        pairs = [{"composed_id": record.id, "member_id": member} for member in set(record.members)]
        connection.execute(uses.insert(), pairs)


def next_entries(connection: Connection, after: int, last: int) -> list[Entry]:
    """Return the next objects after a `seq` (`Store.entries`)."""
    large = (objects.c.theta, objects.c.color, objects.c.photo)
    theta, color, photo = (func.coalesce(func.length(column), 0) for column in large)
    query = select(objects.c.seq, (theta + color + photo).label("size")).order_by(objects.c.seq).limit(BATCH_ROWS)
    bytes_left, end = BATCH_BYTES, after
    for row in connection.execute(query.where(objects.c.seq > after, objects.c.seq <= last)).all():
        bytes_left -= row.size
        if bytes_left < 0 and end > after:
            break
        end = row.seq
    whole = select(*ALL).where(objects.c.seq > after, objects.c.seq <= end).order_by(objects.c.seq)
    return [entry_of(row) for row in connection.execute(whole)]


def find_whole(connection: Connection, object_id: str) -> tuple[Record, Functions] | None:
    """Return an object and its functions, or None (`Store.find`)."""
    row = connection.execute(ONE, {"of": object_id}).first()
    if row is None:
        return None
    record = record_of(row)
    if record.kind != "composed":
        return record, functions_of(row)
    query = select(*WHOLE).where(objects.c.id.in_(record.members))
    members = {each.id: functions_of(each) for each in connection.execute(query)}
    if members.keys() != set(record.members):
        return None  # the object and a member were deleted between the two queries
    return record, join_functions([members[member] for member in record.members])


_spec = lru_cache(CACHED_SPECS)(MappingSpec.from_json)


def record_of(row: Row[Any]) -> Record:
    """Return the record in a row that has at least the columns of `HEADER`."""
    created_at = row.created_at.replace(tzinfo=UTC)  # SQLite drops the zone, which is always UTC
    spec, members = _spec(row.spec), tuple(row.members.split())
    color_spec = _spec(row.color_spec) if row.color_spec else None
    frame = Frame.from_bytes(row.frame) if row.frame else None
    image = ImageReport.from_json(row.image) if row.image else None
    estimates = Estimates.from_json(row.estimates) if row.estimates else None
    return Record(
        row.id,
        row.kind,
        row.model,
        spec,
        created_at,
        members,
        color_spec,
        frame,
        image,
        estimates,
        row.label,
        row.has_photo,
    )


def entry_of(row: Row[Any]) -> Entry:
    """Return the object in a row of `ALL`."""
    record = record_of(row)
    return Entry(row.seq, record, None if record.kind == "composed" else functions_of(row), row.photo)


def functions_of(row: Row[Any]) -> Functions:
    """Return theta, and any color, of a row of `WHOLE`; not for composed objects, which have no theta."""
    theta = _array(row.theta, _spec(row.spec))
    if row.color is None:
        return Functions(theta)
    color_spec = _spec(row.color_spec)
    return Functions(theta, Color(color_spec, _array(row.color, color_spec)))


def _bytes(array: Array) -> bytes:
    """Return the numbers in 2 bytes each if float16 holds all of them exactly, else in 4."""
    single = np.ascontiguousarray(array, dtype="<f4")
    if (single.view("<u4") & BEYOND_HALF).any():  # seldom not: this test is much faster than the conversion
        return single.tobytes()
    with np.errstate(over="ignore"):
        half = array.astype("<f2")
    return (half if np.array_equal(half, array) else single).tobytes()


def _array(data: bytes, spec: MappingSpec) -> Array:
    dtype = "<f2" if len(data) == 2 * spec.size else "<f4"
    return np.frombuffer(data, dtype).astype(np.float32, copy=False)
