"""Ids of objects: digests of what an object is made from, so that a repeat is found, not made again."""

import hashlib
import json
import re
from collections.abc import Sequence
from typing import Final

from service.encoding.framing import Mask
from service.mapping.spec import Array, Functions, MappingSpec

ID_DIGITS: Final = 32  # hexadecimal: 128 bits


def is_id(text: str) -> bool:
    """Whether a text can be the id of an object."""
    return re.fullmatch(rf"[0-9a-f]{{{ID_DIGITS}}}", text) is not None


def encoded_id(image: bytes, mask: Mask, foreground_ratio: float, *model_digests: str) -> str:
    """Id of an encoded object: its image's bytes, how it was framed, and every model file that had a part in it."""
    return _digest(
        "encoded",
        {
            "image": hashlib.sha256(image).hexdigest(),
            "mask": mask,
            "foreground_ratio": foreground_ratio,
            "model": " ".join(model_digests),
        },
    )


def imported_id(spec: MappingSpec, functions: Functions) -> str:
    """Id of an imported object: its theta (spec.size,) float32 and what that means; and its colour, if it has any."""
    parts: dict[str, str | float] = {"spec": spec.to_json(), "theta": _array_digest(functions.theta)}
    if functions.color:
        parts |= {"color_spec": functions.color.spec.to_json(), "color": _array_digest(functions.color.weights)}
    return _digest("imported", parts)


def composed_id(word: Sequence[str]) -> str:
    """Id of a composed object: the ids of its word."""
    return _digest("composed", {"word": " ".join(word)})


def interpolated_id(parents: Sequence[str]) -> str:
    """Id of an interpolated object: the ids of those whose thetas it averages, as they were named."""
    return _digest("interpolated", {"parents": " ".join(parents)})


def _array_digest(array: Array) -> str:
    return hashlib.sha256(array.astype("<f4").tobytes()).hexdigest()


def _digest(kind: str, parts: dict[str, str | float]) -> str:
    text = json.dumps({"kind": kind, **parts}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:ID_DIGITS]
