"""Objects as rows of an Arrow table, the columns of `hof store export` and `hof encode-many`.

A row is an object, or a photo that could not be encoded: its `error` says why, and it has no `id`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC
from typing import Any, Final

import numpy as np
import pyarrow as pa

from service.encoding.estimates import Estimates
from service.encoding.report import ImageReport
from service.errors import CorruptWeights
from service.mapping.frame import Frame
from service.mapping.spec import Array, Color, Functions, MappingSpec
from service.storage.rows import Entry, Record
from service.storage.transfer.content import check_entry, digest_of

NUMBERS: Final = ("theta", "color")
OF_RECORD: Final = ("id", "kind", "model", "created_at", "members", "label")
OF_IMAGE: Final = ("mask", "box", "confidence", "width", "height")
REQUIRED: Final = ("id", "kind", "model", "spec", "created_at", "theta")


@dataclass(frozen=True)
class Item:
    """A row of the table.

    entry : the object; None for a photo that could not be encoded.
    source, sha256 : path and digest of the photo's file.
    error : why the photo could not be encoded.
    """

    entry: Entry | None
    source: str | None = None
    sha256: str | None = None
    error: str | None = None


def schema_of(theta: int | None, color: int | None) -> pa.Schema:
    """Return the schema of a table.

    Parameters
    ----------
    theta, color : numbers in each list; None if they differ between objects, or if no object has such a list.
    """
    return pa.schema(
        [
            ("id", pa.string()),
            ("kind", pa.string()),
            ("model", pa.string()),
            ("created_at", pa.timestamp("us", "UTC")),
            ("spec", pa.string()),
            ("members", pa.list_(pa.string())),
            ("theta", pa.list_(pa.float32(), theta or -1)),
            ("color_spec", pa.string()),
            ("color", pa.list_(pa.float32(), color or -1)),
            ("frame", pa.list_(pa.float32(), 6)),  # the box in the function's own numbers: low, high
            ("dimensions", pa.list_(pa.float32(), 3)),
            ("mask", pa.string()),
            ("box", pa.list_(pa.int32(), 4)),  # of the object in its photo: left, top, right, bottom
            ("confidence", pa.float64()),
            ("width", pa.int32()),
            ("height", pa.int32()),
            ("estimates", pa.string()),
            ("label", pa.string()),
            ("photo", pa.binary()),  # thumbnail, WebP
            ("source", pa.string()),
            ("sha256", pa.string()),
            ("digest", pa.string()),  # of the object's content
            ("error", pa.string()),
        ]
    )


def table_of(items: Sequence[Item], schema: pa.Schema) -> pa.Table:
    """Return rows as a table."""
    rows = [_values(item) for item in items]
    columns = []
    for field in schema:
        values = [row.get(field.name) for row in rows]
        is_fixed = pa.types.is_fixed_size_list(field.type)
        columns.append(_fixed_lists(values, field.type) if is_fixed else pa.array(values, field.type))
    return pa.Table.from_arrays(columns, schema=schema)


def items_of(batch: pa.RecordBatch) -> Iterator[Item]:
    """Yield the rows of a batch; objects are checked. Raises CorruptWeights and InvalidSpec."""
    missing = [name for name in REQUIRED if name not in batch.schema.names]
    if missing:
        raise CorruptWeights(f"the columns {', '.join(missing)} are missing: it is not a table of objects")
    numbers = {name: batch.column(name) for name in NUMBERS if name in batch.schema.names}
    for place, row in enumerate(batch.drop_columns(list(numbers)).to_pylist()):
        if row["id"] is None:
            yield Item(None, row.get("source"), row.get("sha256"), row.get("error"))
        else:
            yield _item(row, {name: _numbers(column[place]) for name, column in numbers.items()})


def _values(item: Item) -> dict[str, Any]:
    """Return the cells of a row; those that are missing are null."""
    values: dict[str, Any] = {"source": item.source, "sha256": item.sha256, "error": item.error}
    if item.entry is None:
        return values
    _, record, functions, photo = item.entry
    values["photo"] = photo
    values |= {name: getattr(record, name) for name in OF_RECORD}
    values |= {"spec": record.spec.to_json(), "digest": digest_of(record, functions)}
    if functions:
        values |= {"theta": functions.theta, "color": functions.color.weights if functions.color else None}
    if record.color_spec:
        values["color_spec"] = record.color_spec.to_json()
    if record.frame:
        values |= {"frame": [*record.frame.low, *record.frame.high], "dimensions": record.frame.dimensions}
    if record.image:
        values |= {name: getattr(record.image, name) for name in OF_IMAGE}
    return values | {"estimates": record.estimates.to_json() if record.estimates else None}


def _fixed_lists(values: Sequence[Any], kind: pa.DataType) -> pa.Array:
    """Return a column of lists of one length: (n, length) numbers, and which rows are null."""
    numbers = np.zeros((len(values), kind.list_size), kind.value_type.to_pandas_dtype())
    for row, value in enumerate(values):
        if value is not None:
            numbers[row] = value
    mask = pa.array([value is None for value in values], pa.bool_())
    return pa.FixedSizeListArray.from_arrays(pa.array(numbers.ravel()), type=kind, mask=mask)


def _numbers(cell: pa.Scalar) -> Array | None:
    """Return the numbers of a list, float32; None for a null."""
    return np.array(cell.values, np.float32) if cell.is_valid else None


def _item(row: dict[str, Any], numbers: dict[str, Array | None]) -> Item:
    """Return the object of a row. Raises CorruptWeights and InvalidSpec."""
    try:
        record = _record(row)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise CorruptWeights(f"the row of the object {row['id'][:64]!r} cannot be read: {error}") from error
    theta, weights = numbers["theta"], numbers.get("color")
    color = None if weights is None or record.color_spec is None else Color(record.color_spec, weights)
    functions = None if theta is None else Functions(theta, color)
    entry = Entry(0, record, functions, row.get("photo"))
    check_entry(entry)
    digest = row.get("digest")
    if digest is not None and digest != digest_of(record, functions):
        raise CorruptWeights(f"the object {record.id} is damaged: its content does not have the digest of its row")
    return Item(entry, row.get("source"), row.get("sha256"))


def _record(row: dict[str, Any]) -> Record:
    spec, color_spec = row["spec"], row.get("color_spec")
    box, image, estimates = row.get("frame"), None, row.get("estimates")
    if row.get("mask") is not None:
        left, top, right, bottom = row["box"]
        size = int(row["width"]), int(row["height"])
        image = ImageReport(row["mask"], (left, top, right, bottom), row["confidence"], *size)
    return Record(
        row["id"],
        row["kind"],
        row["model"],
        MappingSpec.from_json(spec),
        row["created_at"].astimezone(UTC),
        tuple(row.get("members") or ()),
        MappingSpec.from_json(color_spec) if color_spec else None,
        Frame.of(np.array(box[:3], np.float32), np.array(box[3:], np.float32)) if box else None,
        image,
        Estimates.from_json(estimates) if estimates else None,
        row.get("label"),
        row.get("photo") is not None,
    )
