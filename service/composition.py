"""New objects made of stored ones: words of functions (paper, section 3.3 and eq. 5), and means of thetas.

A word of a k-mapping names k objects of one spec. ``("A", "B")`` is f_A(f_B(x)): the last one is applied first.
"""

import itertools
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from typing import Final, Literal

import numpy as np

from service.errors import CorruptWeights, InvalidParameter
from service.formats.weights import MAX_LABEL
from service.ids import composed_id, interpolated_id
from service.mapping import Array, MappingSpec, word_of
from service.points import check_finite
from service.store import Record

Mode = Literal["compose", "interpolate", "all"]

MAX_WORDS: Final = 256  # of one call: k = 8


@dataclass(frozen=True)
class Member:
    """One object of a word, or one that is averaged.

    name : what its user knows it by: its place in the request, or its file.
    is_composed : it is a word itself.
    """

    name: str
    spec: MappingSpec
    is_composed: bool


@dataclass(frozen=True, eq=False)
class Proposal:
    """An object that is not kept yet.

    theta : (spec.size,) float32; None for a composed object.
    word : its k functions, the last one applied first.
    """

    record: Record
    theta: Array | None
    word: tuple[Array, ...]


def check(members: Sequence[Member], mode: Mode) -> None:
    """Refuse what makes no function, with InvalidParameter, which names the member at fault where one is."""
    for member in members:
        if member.is_composed:
            raise InvalidParameter(f"{member.name} is composed: name the objects of its word", field=member.name)
        _check_spec(member, members[0])
    k, count = members[0].spec.k, len(members)
    if mode == "interpolate":
        if count < 2:
            raise InvalidParameter("to interpolate takes two objects or more", field="objects")
        return
    if k < 2:
        raise InvalidParameter("only functions with k of 2 or more are composed, here k is 1", field="objects")
    if mode == "compose" and count != k:
        raise InvalidParameter(f"a word needs k = {k} objects, not {count}", field="objects")
    if mode == "all" and count != 2:
        raise InvalidParameter(f"all words are those of two objects, not {count}", field="objects")
    if mode == "all" and 2**k > MAX_WORDS:
        raise InvalidParameter(f"all would make 2^{k} words, at most {MAX_WORDS}", field="mode")


def propose(found: Sequence[tuple[Record, Array]], mode: Mode) -> list[Proposal]:
    """The objects that a request for stored objects asks for; `all` orders them AA, AB, BA, BB.

    Parameters
    ----------
    found : the objects as named, at least one, each with its theta.

    Raises
    ------
    InvalidParameter : as `check`; two objects of `all` that are one.
    """
    kinds = ((record.spec, record.kind == "composed") for record, _ in found)
    check([Member(f"objects[{index}]", *kind) for index, kind in enumerate(kinds)], mode)
    if mode == "interpolate":
        return [_interpolated(found)]
    if mode == "compose":
        return [_composed(found)]
    if found[0][0].id == found[1][0].id:
        raise InvalidParameter("objects[1] is objects[0]: all words are those of two objects", field="objects[1]")
    return [_composed(word) for word in itertools.product(found, repeat=found[0][0].spec.k)]


def check_values(proposals: Sequence[Proposal]) -> None:
    """Refuse objects whose points exceed float32, with InvalidParameter: each function may be sound, the word not."""
    for proposal in proposals:
        try:
            check_finite(proposal.record.spec, proposal.word)
        except CorruptWeights as error:
            members = ", ".join(proposal.record.members)
            raise InvalidParameter(f"the points of {members} together exceed float32", field="objects") from error


def _composed(word: Sequence[tuple[Record, Array]]) -> Proposal:
    ids = tuple(record.id for record, _ in word)
    record = Record(composed_id(ids), "composed", _model(word), word[0][0].spec, datetime.now(UTC), ids)
    return Proposal(record, None, tuple(theta for _, theta in word))


def _interpolated(parents: Sequence[tuple[Record, Array]]) -> Proposal:
    """The mean of thetas, which the paper compares composition with ("Object Interpolation")."""
    ids, spec = tuple(record.id for record, _ in parents), parents[0][0].spec
    theta = np.stack([theta for _, theta in parents]).mean(axis=0, dtype=np.float64).astype(np.float32)
    record = Record(interpolated_id(ids), "interpolated", _model(parents), spec, datetime.now(UTC), ids)
    return Proposal(record, theta, word_of(spec, theta))


def _model(members: Sequence[tuple[Record, Array]]) -> str:
    """The models that thetas come from, as one name that a weights file can carry."""
    return " + ".join(dict.fromkeys(record.model for record, _ in members))[:MAX_LABEL]


def _check_spec(member: Member, first: Member) -> None:
    theirs = asdict(first.spec)
    for name, value in asdict(member.spec).items():
        if value != theirs[name]:
            raise InvalidParameter(
                f"{member.name} has the {name} {value}, {first.name} {theirs[name]}: specs must be equal",
                field=member.name,
            )
