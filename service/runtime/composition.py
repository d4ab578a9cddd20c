"""Composition: new objects from stored ones, as words of functions (paper, section 3.3 and eq. 5) or means of thetas.

A word of a k-mapping names k objects of one spec. ``("A", "B")`` is f_A(f_B(x)): the last one is applied first.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from typing import Final, Literal

from service.errors import CorruptWeights, InvalidParameter
from service.formats.weights import MAX_NAME
from service.mapping.box import examine
from service.mapping.spec import Functions, MappingSpec, join_functions, mean_of
from service.storage.ids import composed_id, interpolated_id
from service.storage.rows import Record

Mode = Literal["compose", "interpolate", "all"]

MAX_WORDS: Final = 256  # words made by one call: k = 8


@dataclass(frozen=True)
class Member:
    """One object of a word, or one of the objects that are averaged.

    name : for error messages: its place in the request, or its file.
    is_composed : whether it is a word itself.
    color_spec : None if it has no color.
    """

    name: str
    spec: MappingSpec
    is_composed: bool
    color_spec: MappingSpec | None = None


@dataclass(frozen=True, eq=False)
class Proposal:
    """An object that is not stored yet.

    own : its functions; None for a composed object.
    word : the functions of a composed object's word, in order; joined only on access, since `all` makes many words.
    """

    record: Record
    own: Functions | None
    word: tuple[Functions, ...] = ()

    @property
    def functions(self) -> Functions:
        """The functions of the object: its own, or those of its word."""
        return self.own or join_functions(self.word)


def check_members(members: Sequence[Member], mode: Mode) -> None:
    """Raise InvalidParameter if the members make no function; it names the member at fault, if there is one."""
    for member in members:
        if member.is_composed:
            raise InvalidParameter(f"{member.name} is composed: name the objects of its word", field=member.name)
        _check_equal(member.name, member.spec, members[0].name, members[0].spec, "")
    colored = [(member.name, member.color_spec) for member in members if member.color_spec]
    for name, color_spec in colored:
        _check_equal(name, color_spec, *colored[0], "color's ")
    k, count = members[0].spec.k, len(members)
    if mode == "interpolate":
        if count < 2:
            raise InvalidParameter(f"interpolate needs two objects or more, not {count}", field="objects")
        return
    if k < 2:
        raise InvalidParameter(f"composing needs functions with k of 2 or more, here k is {k}", field="objects")
    if mode == "compose" and count != k:
        raise InvalidParameter(f"a word needs k = {k} objects, not {count}", field="objects")
    if mode == "all" and count != 2:
        raise InvalidParameter(f"all words (mode all) are made of two objects, not {count}", field="objects")
    if mode == "all" and 2**k > MAX_WORDS:
        raise InvalidParameter(f"all would make 2^{k} words, at most {MAX_WORDS} are allowed", field="mode")


def check_records(records: Sequence[Record], mode: Mode) -> None:
    """Raise InvalidParameter if stored objects, in the order of the request, make no function: see `check_members`.

    The two objects of `all` must differ.
    """
    kinds = ((record.spec, record.kind == "composed", record.color_spec) for record in records)
    check_members([Member(f"objects[{index}]", *kind) for index, kind in enumerate(kinds)], mode)
    if mode == "all" and records[0].id == records[1].id:
        raise InvalidParameter(
            "objects[1] is objects[0]: all words (mode all) are made of two different objects", field="objects[1]"
        )


def propose(records: Sequence[Record], mode: Mode) -> list[Record]:
    """Return the records of the objects that a request makes of stored ones; `all` orders them AA, AB, BA, BB.

    Parameters
    ----------
    records : the stored objects, in the order of the request; checked by `check_records`.
    """
    if mode == "interpolate":
        return [_record("interpolated", records)]
    if mode == "compose":
        return [_record("composed", records)]
    return [_record("composed", word) for word in itertools.product(records, repeat=records[0].spec.k)]


def with_functions(record: Record, members: Mapping[str, Functions]) -> Proposal:
    """Return a proposed object with its functions, made of those of its members, by their ids."""
    functions = tuple(members[object_id] for object_id in record.members)
    if record.kind == "composed":
        return Proposal(record, None, functions)
    return Proposal(record, mean_of(functions))


def examine_all(proposals: Sequence[Proposal]) -> list[Proposal]:
    """Return the proposals with their frames.

    Raises InvalidParameter if points of an object exceed float32. A word's may, even if those of its functions do not.
    """
    measured = []
    for proposal in proposals:
        try:
            frame = examine(proposal.record.spec, proposal.functions)
            measured.append(replace(proposal, record=replace(proposal.record, frame=frame)))
        except CorruptWeights as error:
            members = ", ".join(proposal.record.members)
            raise InvalidParameter(f"the points of {members} together exceed float32", field="objects") from error
    return measured


def _record(kind: Literal["composed", "interpolated"], members: Sequence[Record]) -> Record:
    """Return the record of a new object. Its model names the models of its members, cut to what a file can carry."""
    ids = tuple(record.id for record in members)
    id_ = composed_id(ids) if kind == "composed" else interpolated_id(ids)
    model = " + ".join(dict.fromkeys(record.model for record in members))[:MAX_NAME]
    color_spec = next((record.color_spec for record in members if record.color_spec), None)
    return Record(id_, kind, model, members[0].spec, datetime.now(UTC), ids, color_spec)


def _check_equal(name: str, spec: MappingSpec, first_name: str, first: MappingSpec, whose: str) -> None:
    theirs = asdict(first)
    for field, value in asdict(spec).items():
        if value != theirs[field]:
            raise InvalidParameter(
                f"{name} has the {whose}{field} {value}, {first_name} {theirs[field]}: specs must be equal", field=name
            )
