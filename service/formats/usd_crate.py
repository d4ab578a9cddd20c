"""Binary files of Universal Scene Description (USD): the "crate" format, .usdc, of version 0.8.

There is no specification: the files are what OpenUSD (pxr/usd/sdf/crateFile.cpp) reads, and our tests read them with
OpenUSD. A file is a head, the values that need more than four bytes, six tables, and a table of those. Values and
names are stored once and then named by their place in a table.

The tables must be compressed: integers by their differences, and the bytes of that in blocks of LZ4. Ours has blocks
without any matches, which are longer than others but need no library.
"""

import struct
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

VERSION: Final = (0, 8, 0)
HEAD_BYTES: Final = 88
ALIGNMENT: Final = 8  # of arrays, so that readers need not copy them

# Types of values (crateDataTypes.h)
_BOOL, _INT, _FLOAT, _DOUBLE, _STRING, _TOKEN, _VEC3F = 1, 3, 8, 9, 10, 11, 24
_TOKEN_LIST_OP, _PATH_LIST_OP, _TOKEN_VECTOR, _SPECIFIER, _VARIABILITY = 32, 34, 41, 42, 44
_ARRAY, _INLINED = 1 << 63, 1 << 62
_EXPLICIT, _PREPENDED = 0b11, 1 << 5  # lists of a list operation: the only items, and those put before others
_ATTRIBUTE, _PRIM, _PSEUDO_ROOT, _RELATIONSHIP = 1, 6, 7, 8  # types of specs (SdfSpecType)
_UNIFORM: Final = 1

Fields = Mapping[str, int]  # name of a field -> its value as 8 bytes of the file hold it


@dataclass(frozen=True, eq=False)
class Attribute:
    """A value of a prim.

    name, type : for example "points", "point3f[]"; the types are those of `_Writer.value`.
    value : of the type; an array for "[]"; None for an output of a shader.
    is_uniform : whether the value may not change in time.
    interpolation : of an array on a mesh, for example "vertex".
    source : path of the attribute that the value comes from.
    """

    name: str
    type: str
    value: Any = None
    is_uniform: bool = False
    interpolation: str | None = None
    source: str | None = None


@dataclass(frozen=True)
class Relationship:
    """A reference of a prim to another one, by its path."""

    name: str
    target: str


@dataclass(frozen=True)
class Prim:
    """A thing in the scene, with its properties and the things in it. `apis` are its applied schemas."""

    name: str
    type: str
    properties: Sequence[Attribute | Relationship] = ()
    children: Sequence["Prim"] = ()
    apis: Sequence[str] = ()


def dump(scene: Prim, comment: str) -> bytes:
    """Write the whole file of a scene, whose unit is the meter and whose axis +Y is up."""
    return _Writer(scene).file(comment)


@dataclass(frozen=True)
class _Node:
    """An entry of the table of paths: a prim or a property, and what comes below it."""

    name: str
    item: Prim | Attribute | Relationship | None  # None for the root
    below: Sequence["_Node"] = ()

    @property
    def size(self) -> int:
        return 1 + sum(node.size for node in self.below)


class _Writer:
    """The values and tables of a file."""

    def __init__(self, scene: Prim) -> None:
        self._root = _Node("", None, [_node(scene)])
        self._paths = {path: index for index, path in enumerate(_paths(self._root, ""))}
        self._scene = scene
        self._body = bytearray(HEAD_BYTES)
        self._tokens = {";-)": 0}  # as OpenUSD has it: negative numbers of names mark properties, and -0 is none
        self._strings: list[int] = []
        self._fields: dict[tuple[int, int], int] = {}
        self._field_sets: list[int] = []
        self._value: Final[Mapping[str, Callable[[Any], int]]] = {
            "bool": lambda value: _inline(_BOOL, int(value)),
            "float": lambda value: _inline(_FLOAT, _float_bits(value)),
            "double": lambda value: _inline(_DOUBLE, _float_bits(value)),  # for values that float32 holds exactly
            "token": lambda value: _inline(_TOKEN, self._token(value)),
            "string": self._string,
            "color3f": lambda value: self._stored(_VEC3F, np.asarray(value, "<f4").tobytes()),
            "int[]": lambda value: self._array(_INT, np.asarray(value, "<i4")),
            **dict.fromkeys(
                ("float3[]", "point3f[]", "normal3f[]", "color3f[]"),
                lambda value: self._array(_VEC3F, np.asarray(value, "<f4")),
            ),
        }

    def file(self, comment: str) -> bytes:
        specs = [(kind, self._field_set(fields)) for kind, fields in self._specs(self._root, comment)]
        tables = {  # the first ones last: they get entries while the others are written
            "SPECS": self._spec_table(specs),
            "PATHS": self._path_table(),
            "FIELDSETS": struct.pack("<Q", len(self._field_sets)) + _integers(self._field_sets),
            "FIELDS": self._field_table(),
            "STRINGS": struct.pack(f"<Q{len(self._strings)}I", len(self._strings), *self._strings),
            "TOKENS": self._token_table(),
        }
        contents = struct.pack("<Q", len(tables))
        for name, table in reversed(tables.items()):
            contents += struct.pack("<16sQQ", name.encode("ascii"), len(self._body), len(table))
            self._body += table
        struct.pack_into("<8s8BQ", self._body, 0, b"PXR-USDC", *VERSION, *bytes(5), len(self._body))
        return bytes(self._body + contents)

    def _specs(self, node: _Node, comment: str) -> Iterator[tuple[int, Fields]]:
        """Return the type and the fields of a node and of all below it, in the order of the table of paths."""
        match node.item:
            case None:
                yield _PSEUDO_ROOT, self._root_fields(comment)
            case Prim() as prim:
                yield _PRIM, self._prim_fields(prim)
            case Attribute() as attribute:
                yield _ATTRIBUTE, self._attribute_fields(attribute)
            case Relationship(target=target):
                yield (
                    _RELATIONSHIP,
                    {
                        "variability": _inline(_VARIABILITY, _UNIFORM),
                        "targetPaths": self._list(_PATH_LIST_OP, _EXPLICIT, [self._paths[target]]),
                    },
                )
        for each in node.below:
            yield from self._specs(each, comment)

    def _root_fields(self, comment: str) -> Fields:
        return {
            "comment": self._string(comment),
            "defaultPrim": self._value["token"](self._scene.name),
            "metersPerUnit": self._value["double"](1),
            "upAxis": self._value["token"]("Y"),
            "primChildren": self._names([self._scene]),
        }

    def _prim_fields(self, prim: Prim) -> Fields:
        fields = {"specifier": _inline(_SPECIFIER, 0), "typeName": self._value["token"](prim.type)}
        if prim.apis:
            fields["apiSchemas"] = self._list(_TOKEN_LIST_OP, _PREPENDED, map(self._token, prim.apis))
        if prim.properties:
            fields["properties"] = self._names(prim.properties)
        if prim.children:
            fields["primChildren"] = self._names(prim.children)
        return fields

    def _attribute_fields(self, attribute: Attribute) -> Fields:
        fields = {"typeName": self._value["token"](attribute.type)}
        if attribute.is_uniform:
            fields["variability"] = _inline(_VARIABILITY, _UNIFORM)
        if attribute.interpolation:
            fields["interpolation"] = self._value["token"](attribute.interpolation)
        if attribute.value is not None:
            fields["default"] = self._value[attribute.type](attribute.value)
        if attribute.source:
            fields["connectionPaths"] = self._list(_PATH_LIST_OP, _EXPLICIT, [self._paths[attribute.source]])
        return fields

    def _token(self, name: str) -> int:
        return self._tokens.setdefault(name, len(self._tokens))

    def _string(self, text: str) -> int:
        self._strings.append(self._token(text))
        return _inline(_STRING, len(self._strings) - 1)

    def _names(self, items: Sequence[Prim | Attribute | Relationship]) -> int:
        tokens = [self._token(item.name) for item in items]
        return self._stored(_TOKEN_VECTOR, struct.pack(f"<Q{len(tokens)}I", len(tokens), *tokens))

    def _list(self, kind: int, items: int, indices: Iterator[int] | Sequence[int]) -> int:
        numbers = list(indices)
        return self._stored(kind, struct.pack(f"<BQ{len(numbers)}I", items, len(numbers), *numbers))

    def _array(self, kind: int, array: np.ndarray[Any, Any]) -> int:
        return self._stored(kind, struct.pack("<Q", len(array)), array.data) | _ARRAY if len(array) else kind << 48

    def _stored(self, kind: int, *pieces: bytes | memoryview) -> int:
        """Store a value in the file's body."""
        self._body += bytes(-len(self._body) % ALIGNMENT)
        place = len(self._body)
        for piece in pieces:
            self._body += piece
        return kind << 48 | place

    def _field_set(self, fields: Fields) -> int:
        """Add fields to the tables; return the place of their set."""
        place = len(self._field_sets)
        for name, value in fields.items():
            field = self._token(name), value
            self._field_sets.append(self._fields.setdefault(field, len(self._fields)))
        self._field_sets.append(-1)
        return place

    def _spec_table(self, specs: Sequence[tuple[int, int]]) -> bytes:
        kinds, field_sets = zip(*specs, strict=True)
        columns = range(len(specs)), field_sets, kinds
        return struct.pack("<Q", len(specs)) + b"".join(map(_integers, columns))

    def _path_table(self) -> bytes:
        names, jumps = zip(*self._path_rows(self._root, is_last=True), strict=True)
        columns = range(len(names)), names, jumps
        return struct.pack("<QQ", len(names), len(names)) + b"".join(map(_integers, columns))

    def _path_rows(self, node: _Node, *, is_last: bool) -> Iterator[tuple[int, int]]:
        """Return, for a node and all below it, the name, negative for a property, and the rows to the next sibling.

        Without a sibling it is -1 with nodes below and -2 without; without nodes below it is 0.
        """
        name = self._token(node.name)
        jump = (-1 if node.below else -2) if is_last else (node.size if node.below else 0)
        yield -name if isinstance(node.item, Attribute | Relationship) else name, jump
        for each in node.below:
            yield from self._path_rows(each, is_last=each is node.below[-1])

    def _field_table(self) -> bytes:
        names, values = zip(*self._fields, strict=True)
        packed = _compressed(struct.pack(f"<{len(values)}Q", *values))
        return struct.pack("<Q", len(names)) + _integers(names) + struct.pack("<Q", len(packed)) + packed

    def _token_table(self) -> bytes:
        text = b"".join(token.encode() + b"\0" for token in self._tokens)
        packed = _compressed(text)
        return struct.pack("<3Q", len(self._tokens), len(text), len(packed)) + packed


def _node(prim: Prim) -> _Node:
    properties = [_Node(each.name, each) for each in prim.properties]
    return _Node(prim.name, prim, [*properties, *map(_node, prim.children)])


def _paths(node: _Node, above: str) -> Iterator[str]:
    """Return the path of a node, and of all below it, in the order of the table of paths."""
    path = above + ("" if node.item is None else ("/" if isinstance(node.item, Prim) else ".") + node.name)
    yield path
    for each in node.below:
        yield from _paths(each, path)


def _inline(kind: int, bits: int) -> int:
    """Return a value that is stored where it is used."""
    return _INLINED | kind << 48 | bits


def _float_bits(value: float) -> int:
    bits: int = struct.unpack("<I", struct.pack("<f", value))[0]
    return bits


def _integers(numbers: Sequence[int]) -> bytes:
    """Compress a column of integers: their differences, the commonest in 2 bits and the others in 34."""
    differences = [number - before for before, number in zip([0, *numbers[:-1]], numbers, strict=True)]
    common = Counter(differences).most_common(1)[0][0]
    others = [each for each in differences if each != common]
    codes = [0 if each == common else 3 for each in differences]
    codes += [0] * (-len(codes) % 4)
    packed = bytes(a | b << 2 | c << 4 | d << 6 for a, b, c, d in zip(*[iter(codes)] * 4, strict=True))
    data = _compressed(struct.pack("<i", common) + packed + struct.pack(f"<{len(others)}i", *others))
    return struct.pack("<Q", len(data)) + data


def _compressed(data: bytes) -> bytes:
    """Write one chunk of one LZ4 block that repeats nothing (github.com/lz4/lz4, lz4_Block_format.md)."""
    if len(data) < 15:
        return bytes([0, len(data) << 4]) + data
    more, last = divmod(len(data) - 15, 255)
    return bytes([0, 15 << 4]) + b"\xff" * more + bytes([last]) + data
