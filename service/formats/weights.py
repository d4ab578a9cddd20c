"""theta and its spec as a file: safetensors, which `load` reads back, .npy, JSON, and ONNX, which runs anywhere.

A safetensors file is a uint64 header length, a JSON header and the bytes of the tensors
(https://huggingface.co/docs/safetensors). Ours has a tensor "theta" and its spec in the metadata. A composed object
has a theta of k rows, and "word" in the metadata names the object of each row. An object with a color has a tensor
"color", and its spec is "color_spec" in the metadata. "frame" in the metadata is the object's box. The safetensors
library sets no limit on what it parses and reads metadata from named files only, so both directions are written here.
"""

import io
import itertools
import json
import math
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

import numpy as np

from service.errors import CorruptWeights, InvalidParameter
from service.formats import onnx
from service.mapping.frame import Frame
from service.mapping.spec import Array, Color, Functions, MappingSpec, check_color_spec

WeightFormatName = Literal["safetensors", "npy", "json", "onnx"]

FORMAT: Final = "hof-theta-1"
WORD_FORMAT: Final = "hof-word-1"  # for composed objects
MAX_HEADER_BYTES: Final = 16_384
MAX_JSON_NUMBERS: Final = 1_000_000  # as text or as Python objects, a number takes far more than 4 bytes
MAX_LABEL: Final = 200  # characters of a name

Shapes = dict[str, list[int]]  # of tensors, by name


@dataclass(frozen=True, eq=False)
class Weights:
    """A mapping function, or the k functions of a composed object.

    spec : shape of each function.
    theta : (spec.size,) float32; for a composed object (spec.k, spec.size), the last row applied first.
    model : name of the encoder that computed theta.
    word : names of the objects of a composed object's rows; empty for any other object.
    color : None if the object has no color.
    frame : the object's box in the function's own numbers; None if it was not measured.
    """

    spec: MappingSpec
    theta: Array
    model: str
    word: tuple[str, ...] = ()
    color: Color | None = None
    frame: Frame | None = None

    @property
    def functions(self) -> Functions:
        """Parameters alone: theta, and the color if there is one."""
        return Functions(self.theta, self.color)

    @property
    def labels(self) -> dict[str, str]:
        """Metadata of the file as text: everything but the numbers and the color's spec."""
        labels = {"format": FORMAT, "model": self.model, "spec": self.spec.to_json()}
        if self.frame:
            labels["frame"] = self.frame.to_json()
        return labels | {"format": WORD_FORMAT, "word": json.dumps(self.word)} if self.word else labels


@dataclass(frozen=True)
class WeightFormat:
    """A file format for weights; `extension` has its dot."""

    media_type: str
    extension: str


WEIGHT_FORMATS: Final[Mapping[WeightFormatName, WeightFormat]] = {
    "safetensors": WeightFormat("application/x-safetensors", ".safetensors"),
    "npy": WeightFormat("application/x-npy", ".npy"),
    "json": WeightFormat("application/json", ".json"),
    "onnx": WeightFormat("application/x-onnx", ".onnx"),
}


def dump(weights: Weights, format: WeightFormatName) -> bytes:  # noqa: A002 - the name in the API
    """Write the whole file. Equal weights give equal bytes.

    `npy` holds theta alone, little-endian float32. `json` has the keys format, model, spec, frame (if it was
    measured), word (for a composed object), theta, color_spec and color (if the object has a color); its numbers
    restore the same float32. `onnx` is the whole function, x -> points, without color; with a frame, its points are in
    the object frame.

    Raises
    ------
    InvalidParameter : more than `MAX_JSON_NUMBERS` numbers for JSON.
    """
    match format:
        case "safetensors":
            return _dump_safetensors(weights)
        case "npy":
            buffer = io.BytesIO()
            np.save(buffer, weights.theta.astype("<f4", copy=False), allow_pickle=False)
            return buffer.getvalue()
        case "json":
            count = weights.theta.size + (weights.color.weights.size if weights.color else 0)
            if count > MAX_JSON_NUMBERS:
                detail = f"the object has {count} numbers, JSON holds at most {MAX_JSON_NUMBERS}: use safetensors"
                raise InvalidParameter(detail, field="format")
            fields: dict[str, Any] = {**weights.labels, "spec": asdict(weights.spec), "theta": weights.theta.tolist()}
            if weights.frame:
                fields["frame"] = asdict(weights.frame)
            if weights.word:
                fields["word"] = weights.word
            if weights.color:
                fields |= {"color_spec": asdict(weights.color.spec), "color": weights.color.weights.tolist()}
            return json.dumps(fields, separators=(",", ":")).encode("ascii")
        case "onnx":
            labels = {f"hof.{key}": text for key, text in weights.labels.items() if key != "format"}
            return onnx.dump(weights.spec, weights.theta, labels, weights.frame)


def load(data: bytes) -> Weights:
    """Read a safetensors file written by `dump` or by another program.

    Raises
    ------
    CorruptWeights : the bytes are not such a file, its metadata are incomplete, or a tensor has the wrong type or
        size or a number that is not finite.
    InvalidSpec : a spec is invalid, or the color's spec does not fit.
    """
    header, payload = _split(data)
    metadata = header.pop("__metadata__", None)
    if not isinstance(metadata, dict) or metadata.get("format") not in (FORMAT, WORD_FORMAT):
        raise CorruptWeights(f'the metadata lack "format": "{FORMAT}" or "{WORD_FORMAT}"')
    model, text = metadata.get("model"), metadata.get("spec")
    if not isinstance(model, str) or not isinstance(text, str):
        raise CorruptWeights('the metadata lack "model" or "spec"')
    spec = MappingSpec.from_json(text)
    _check_label(model)
    _check_label(spec.name)
    word = _word(metadata.get("word"), spec.k) if metadata["format"] == WORD_FORMAT else ()
    color_spec = _color_spec(metadata["color_spec"], spec) if "color_spec" in metadata else None
    arrays = _arrays(header, payload, list(_tensors(spec, color_spec, bool(word))))
    color = Color(color_spec, arrays["color"]) if color_spec else None
    frame = Frame.from_json(metadata["frame"]) if "frame" in metadata else None
    return Weights(spec, arrays["theta"], model, word, color, frame)


def _color_spec(text: object, spec: MappingSpec) -> MappingSpec:
    """Read the color's spec and check that it fits the mapping function's."""
    if not isinstance(text, str):
        raise CorruptWeights('"color_spec" in the metadata is not a string')
    color_spec = MappingSpec.from_json(text)
    _check_label(color_spec.name)
    check_color_spec(spec, color_spec)
    return color_spec


def _tensors(spec: MappingSpec, color_spec: MappingSpec | None, is_word: bool) -> Iterator[Shapes]:
    """Return the tensors that a file may have; in a word, 1 to k functions may have a color."""
    theta = {"theta": [spec.k, spec.size] if is_word else [spec.size]}
    if color_spec is None:
        yield theta
    elif is_word:
        yield from (theta | {"color": [colored, color_spec.size]} for colored in range(spec.k, 0, -1))
    else:
        yield theta | {"color": [color_spec.size]}


def _arrays(header: dict[str, Any], payload: memoryview, allowed: Sequence[Shapes]) -> dict[str, Array]:
    """Read the tensors, in any order in the file. Raises CorruptWeights."""
    for shapes in allowed:
        for order in itertools.permutations(shapes):
            entries = _entries({name: shapes[name] for name in order})
            if header == entries and len(payload) == _end(entries):
                return {name: _array(name, payload, entry) for name, entry in entries.items()}
    tensors = " and ".join(f'"{name}" of shape {shape}' for name, shape in allowed[0].items())
    raise CorruptWeights(f"the file must hold {tensors}, F32, and nothing else")


def _entries(shapes: Shapes) -> dict[str, dict[str, Any]]:
    """Return the header's entries for float32 tensors, stored one after another."""
    entries: dict[str, dict[str, Any]] = {}
    for name, shape in shapes.items():
        begin = _end(entries)
        entries[name] = {"dtype": "F32", "shape": shape, "data_offsets": [begin, begin + 4 * math.prod(shape)]}
    return entries


def _end(entries: dict[str, dict[str, Any]]) -> int:
    return max((entry["data_offsets"][1] for entry in entries.values()), default=0)


def _array(name: str, payload: memoryview, entry: dict[str, Any]) -> Array:
    begin, end = entry["data_offsets"]
    array: Array = np.frombuffer(payload[begin:end], "<f4").reshape(entry["shape"]).astype(np.float32)
    if not np.isfinite(array).all():
        raise CorruptWeights(f"{name} has numbers that are not finite")
    return array


def _dump_safetensors(weights: Weights) -> bytes:
    metadata, arrays = weights.labels, {"theta": weights.theta}
    if weights.color:
        metadata |= {"color_spec": weights.color.spec.to_json()}
        arrays |= {"color": weights.color.weights}
    header = {"__metadata__": metadata} | _entries({name: list(array.shape) for name, array in arrays.items()})
    text = json.dumps(header, separators=(",", ":")).encode("ascii")
    text = text.ljust(-len(text) % 8 + len(text))  # tensors start at a multiple of 8 bytes
    payload = b"".join(array.astype("<f4", copy=False).tobytes() for array in arrays.values())
    return struct.pack("<Q", len(text)) + text + payload


def _split(data: bytes) -> tuple[dict[str, Any], memoryview]:
    """Return the decoded header and the bytes of the tensors. Raises CorruptWeights."""
    if len(data) < 8:
        raise CorruptWeights("the file has fewer than 8 bytes: it is not a safetensors file")
    (size,) = struct.unpack_from("<Q", data)
    if size > MAX_HEADER_BYTES:
        raise CorruptWeights(f"the header has {size} bytes, it may have at most {MAX_HEADER_BYTES}")
    if len(data) < 8 + size:
        raise CorruptWeights("the file ends within its header")
    try:
        header = json.loads(data[8 : 8 + size])
    except (ValueError, RecursionError) as error:
        raise CorruptWeights("the header is not JSON") from error
    if not isinstance(header, dict):
        raise CorruptWeights("the header is not a JSON object")
    return header, memoryview(data)[8 + size :]


def _word(text: object, k: int) -> tuple[str, ...]:
    """Read the word in a composed object's metadata: a JSON list of k names. Raises CorruptWeights."""
    try:
        word = json.loads(text) if isinstance(text, str) else None
    except (ValueError, RecursionError):
        word = None
    if not isinstance(word, list) or len(word) != k or not all(isinstance(name, str) for name in word):
        raise CorruptWeights(f'"word" in the metadata is not a list of {k} names')
    for name in word:
        _check_label(name)
    return tuple(word)


def _check_label(text: str) -> None:
    """Raise CorruptWeights unless a name can be shown and stored: no control characters, no lone surrogates."""
    if not (0 < len(text) <= MAX_LABEL and text.isprintable()):
        raise CorruptWeights(f"a name must have 1 to {MAX_LABEL} printable characters")
