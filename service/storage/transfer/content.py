"""Digests of objects, and objects checked against a store."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import groupby
from typing import get_args

import numpy as np

from service.encoding.pixels import MAX_THUMBNAIL_BYTES
from service.errors import CorruptWeights
from service.labels import clean_label
from service.mapping.spec import Array, Functions, MappingSpec, check_color_spec
from service.storage.ids import is_id
from service.storage.rows import Entry, Kind, Record
from service.storage.store import Store


@dataclass
class Tally:
    """Objects of a copy or an import.

    copied : new in the target.
    present : were there already, with the same content.
    skipped : rows that hold no object.
    different : ids of objects that are there with other content; the target's stays.
    """

    copied: int = 0
    present: int = 0
    skipped: int = 0
    different: list[str] = field(default_factory=list)

    @property
    def total(self) -> int:
        """Number of rows that were handled."""
        return self.copied + self.present + self.skipped + len(self.different)

    def __str__(self) -> str:
        parts = [f"{self.copied} new objects", f"{self.present} that were there already"]
        parts += [f"{self.skipped} rows without an object"] if self.skipped else []
        return ", ".join(parts)


def digest_of(record: Record, functions: Functions | None) -> str:
    """Return the sha256 of an object's content, hexadecimal: its kind, specs, members, theta and color.

    What may differ between two stores does not count: time, label, measured box, what is kept of the photo.
    """
    color = functions.color if functions else None
    fields = {
        "id": record.id,
        "kind": record.kind,
        "spec": record.spec.to_json(),
        "members": record.members,
        "theta": _sha256(functions.theta) if functions else None,
        "color_spec": color.spec.to_json() if color else None,
        "color": _sha256(color.weights) if color else None,
    }
    return hashlib.sha256(json.dumps(fields, sort_keys=True).encode()).hexdigest()


def check_entry(entry: Entry) -> None:
    """Raise CorruptWeights or InvalidSpec unless a store may hold this object."""
    record, functions, photo = entry.record, entry.functions, entry.photo
    for each in (record.id, *record.members):
        if not is_id(each):
            raise CorruptWeights(f"{each[:64]!r} is not an id of an object")
    if record.label is not None and record.label != clean_label(record.label):
        raise CorruptWeights(f"the label of the object {record.id} is empty, or has spaces around it")
    if photo is not None and (len(photo) > MAX_THUMBNAIL_BYTES or photo[:4] + photo[8:12] != b"RIFFWEBP"):
        raise CorruptWeights(f"the photo of the object {record.id} is no WebP of up to {MAX_THUMBNAIL_BYTES} bytes")
    if record.kind not in get_args(Kind) or not record.model:
        raise CorruptWeights(f"the object {record.id} needs a model, and a kind: one of {', '.join(get_args(Kind))}")
    if record.kind == "composed":
        if len(record.members) != record.spec.k or functions:
            raise CorruptWeights(f"the composed object {record.id} needs {record.spec.k} members, and no theta")
        return
    if functions is None:
        raise CorruptWeights(f"the object {record.id} has no theta")
    _check_numbers(record.id, "theta", record.spec, functions.theta)
    if functions.color:
        check_color_spec(record.spec, functions.color.spec)
        _check_numbers(record.id, "color", functions.color.spec, functions.color.weights)


async def put_checked(target: Store, entries: Sequence[Entry], tally: Tally) -> None:
    """Put the objects that a store lacks, then read all of them back and compare their digests.

    Raises
    ------
    NotFound : a composed object's word names an object that neither the store nor `entries` have.
    """
    ids = {entry.record.id for entry in entries}
    existing = await target.records(list(ids))
    fresh = {entry.record.id: entry for entry in reversed(entries) if entry.record.id not in existing}
    # In the order given, which `put_all` keeps only for objects that are not made of others.
    for _, run in groupby(reversed(fresh.values()), lambda entry: entry.record.id if entry.record.members else ""):
        batch = list(run)
        photos = {entry.record.id: entry.photo for entry in batch if entry.photo}
        await target.put_all([(entry.record, entry.functions) for entry in batch], photos)
    stored = {entry.record.id: digest_of(entry.record, entry.functions) for entry in await target.entries_of(ids)}
    for entry in entries:
        object_id = entry.record.id
        if stored.get(object_id) != digest_of(entry.record, entry.functions):
            tally.different.append(object_id)
        elif fresh.pop(object_id, None):
            tally.copied += 1
        else:
            tally.present += 1


def _check_numbers(object_id: str, name: str, spec: MappingSpec, numbers: Array) -> None:
    if numbers.shape != (spec.size,):
        raise CorruptWeights(f"{name} of the object {object_id} has {numbers.size} numbers, its spec needs {spec.size}")
    if not np.isfinite(numbers).all():
        raise CorruptWeights(f"{name} of the object {object_id} has a number that is not finite")


def _sha256(numbers: Array) -> str:
    return hashlib.sha256(numbers.astype("<f4").tobytes()).hexdigest()
