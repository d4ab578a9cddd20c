"""JSON to frozen dataclasses, by their annotations. Unknown members are ignored, so that newer services work too."""

import base64
import binascii
import dataclasses
import types
from collections.abc import Mapping
from datetime import datetime
from functools import cache
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

T = TypeVar("T")


def parse(kind: type[T], value: object) -> T:
    """Return decoded JSON as an instance of a dataclass.

    Tuples are arrays, `datetime` is RFC 3339, a NumPy array is base64 of little-endian float32. A member that may be
    None may be absent.

    Raises
    ------
    ValueError : a member is missing or of another type; the message names it.
    """
    result: T = _parse(kind, value, "")
    return result


def _parse(kind: Any, value: object, where: str) -> Any:  # noqa: ANN401
    origin = get_origin(kind)
    if origin is types.UnionType:
        (some,) = (each for each in get_args(kind) if each is not types.NoneType)
        return None if value is None else _parse(some, value, where)
    if dataclasses.is_dataclass(kind):
        return _parse_members(kind, value, where)
    if origin is tuple:
        return _parse_array(get_args(kind), value, where)
    if origin is np.ndarray:
        return _floats(_check(str, value, where), where)
    if origin is Mapping:
        return _check(dict, value, where)
    if kind is datetime:
        return datetime.fromisoformat(_check(str, value, where))
    return float(_check((int, float), value, where)) if kind is float else _check(kind, value, where)


def _parse_members(kind: Any, value: object, where: str) -> Any:  # noqa: ANN401
    members = _check(dict, value, where)
    values = {}
    for field, hint in _hints(kind).items():
        name = f"{where}.{field}".removeprefix(".")
        if field in members:
            values[field] = _parse(hint, members[field], name)
        elif types.NoneType not in get_args(hint):
            raise ValueError(f"{name} is missing")
    return kind(**values)


def _parse_array(kinds: tuple[Any, ...], value: object, where: str) -> tuple[Any, ...]:
    """Return an array as a tuple: of any length for `tuple[X, ...]`, otherwise of the annotation's."""
    items = _check(list, value, where)
    if kinds[-1] is Ellipsis:
        kinds = kinds[:1] * len(items)
    if len(items) != len(kinds):
        raise ValueError(f"{where} has {len(items)} items instead of {len(kinds)}")
    return tuple(_parse(kind, item, f"{where}[{i}]") for i, (kind, item) in enumerate(zip(kinds, items, strict=True)))


def _check(kind: Any, value: object, where: str) -> Any:  # noqa: ANN401
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        raise ValueError(f"{where or 'the body'} has the type {type(value).__name__}")
    return value


def _floats(text: str, where: str) -> np.ndarray[Any, np.dtype[np.float32]]:
    try:
        return np.frombuffer(base64.b64decode(text, validate=True), "<f4").astype(np.float32)
    except (binascii.Error, ValueError) as error:
        raise ValueError(f"{where} is no base64 of float32 numbers") from error


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)
