"""Ids of objects: digests of the inputs, so that a repeated call returns the stored object."""

import hashlib
import json
import re
from collections.abc import Sequence
from typing import Final

from service.encoding.masks import Mask
from service.mapping.spec import Array, Functions, MappingSpec

ID_DIGITS: Final = 32  # hexadecimal: 128 bits
MATTED_FRAMING: Final = 3  # raise with each change of how photos are framed whose mask is of a network
MAX_QUOTED: Final = 64  # characters of a malformed id that an error repeats


def is_id(text: str) -> bool:
    """Return whether a text has the form of an id."""
    return re.fullmatch(rf"[0-9a-f]{{{ID_DIGITS}}}", text) is not None


def encoded_id(image: bytes, mask: Mask, foreground_ratio: float, *model_digests: str) -> str:
    """Return the id of an encoded object: digest of image bytes, framing, and all model files involved."""
    parts: dict[str, str | float] = {
        "image": hashlib.sha256(image).hexdigest(),
        "mask": mask,
        "foreground_ratio": foreground_ratio,
        "model": " ".join(model_digests),
    }
    return _digest("encoded", parts | ({"framing": MATTED_FRAMING} if mask == "matting" else {}))


def views_id(ids: Sequence[str]) -> str:
    """Return the id of an object that is encoded from several images: digest of the id of each, in the order given."""
    return _digest("encoded", {"views": " ".join(ids)})


def points_id(data: bytes, model_digest: str) -> str:
    """Return the id of an object that is completed from points: digest of the file's bytes and of the model file."""
    return _digest("encoded", {"points": hashlib.sha256(data).hexdigest(), "model": model_digest})


def imported_id(spec: MappingSpec, functions: Functions) -> str:
    """Return the id of an imported object: digest of theta, (spec.size,) float32, its spec, and its color if any."""
    parts: dict[str, str | float] = {"spec": spec.to_json(), "theta": _array_digest(functions.theta)}
    if functions.color:
        parts |= {"color_spec": functions.color.spec.to_json(), "color": _array_digest(functions.color.weights)}
    return _digest("imported", parts)


def composed_id(word: Sequence[str]) -> str:
    """Return the id of a composed object: digest of the ids of its word."""
    return _digest("composed", {"word": " ".join(word)})


def interpolated_id(parents: Sequence[str]) -> str:
    """Return the id of an interpolated object: digest of its parents' ids, in the order given."""
    return _digest("interpolated", {"parents": " ".join(parents)})


def _array_digest(array: Array) -> str:
    return hashlib.sha256(array.astype("<f4").tobytes()).hexdigest()


def _digest(kind: str, parts: dict[str, str | float]) -> str:
    text = json.dumps({"kind": kind, **parts}, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:ID_DIGITS]
