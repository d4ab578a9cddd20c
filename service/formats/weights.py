"""theta and its spec as a file: safetensors, which `load` reads back, .npy, JSON, and ONNX, which runs anywhere.

A safetensors file (`service.formats.tensors`) of ours has a tensor "theta" and its spec in the metadata. A composed
object has a theta of k rows, and "word" in the metadata names the object of each row. An object with a color has a
tensor "color", and its spec is "color_spec" in the metadata. "frame" in the metadata is the object's box. Tensors are
F32, F16 or I8. I8 ones have their scales in another tensor, "theta_scales". "loss" in the metadata is how far points
move because of fewer bytes (`service.formats.precision`).
"""

import io
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final, Literal

import numpy as np

from service.errors import CorruptWeights, InvalidParameter
from service.formats import onnx, tensors
from service.formats.precision import Dtype, Loss, from_int8, loss_of, scales_of, to_int8
from service.formats.rounding import close_float16
from service.formats.tensors import Stored, Tensors
from service.labels import clean_label
from service.mapping.frame import Frame
from service.mapping.spec import Array, Color, Functions, MappingSpec, check_color_spec

WeightFormatName = Literal["safetensors", "npy", "json", "onnx"]

FORMAT: Final = "hof-theta-1"
WORD_FORMAT: Final = "hof-word-1"  # for composed objects
MAX_JSON_NUMBERS: Final = 1_000_000  # as text or as Python objects, a number takes far more than 4 bytes
MAX_NAME: Final = 200  # characters of a model's, a spec's or an object's name

TYPES: Final[Mapping[Dtype, str]] = {"float32": "F32", "float16": "F16", "int8": "I8"}


@dataclass(frozen=True, eq=False)
class Weights:
    """A mapping function, or the k functions of a composed object.

    spec : shape of each function.
    theta : (spec.size,) float32; for a composed object (spec.k, spec.size), the last row applied first.
    model : name of the encoder that computed theta.
    word : names of the objects of a composed object's rows; empty for any other object.
    color : None if the object has no color.
    frame : the object's box in the function's own numbers; None if it was not measured.
    dtype : type of the numbers in a file; in memory they are float32.
    loss : of a file that was read: what the type costs, if the file says so.
    label : the name that people gave the object, as `service.labels.clean_label` returns it; None without one.
    """

    spec: MappingSpec
    theta: Array
    model: str
    word: tuple[str, ...] = ()
    color: Color | None = None
    frame: Frame | None = None
    dtype: Dtype = "float32"
    loss: Loss | None = None
    label: str | None = None

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
        if self.label:
            labels["label"] = self.label
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
    InvalidParameter : more than `MAX_JSON_NUMBERS` numbers for JSON; another dtype than float32, which `format` does
        not have, or which does not have the range.
    """
    check_dtype(format, weights.dtype)
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


def check_dtype(format: WeightFormatName, dtype: Dtype) -> None:  # noqa: A002 - the name in the API
    """Raise InvalidParameter if a format does not have a type of numbers."""
    if dtype != "float32" and format != "safetensors":
        raise InvalidParameter(f"{format} files are float32, not {dtype}: use format=safetensors", field="dtype")


def load(data: bytes) -> Weights:
    """Read a safetensors file written by `dump` or by another program.

    Raises
    ------
    CorruptWeights : the bytes are not such a file, its metadata are incomplete, or a tensor has the wrong type or
        size or a number that is not finite.
    InvalidSpec : a spec is invalid, or the color's spec does not fit.
    """
    header, payload = tensors.split(data)
    metadata = header.pop("__metadata__", None)
    if not isinstance(metadata, dict) or metadata.get("format") not in (FORMAT, WORD_FORMAT):
        raise CorruptWeights(f'the metadata lack "format": "{FORMAT}" or "{WORD_FORMAT}"')
    model, text = metadata.get("model"), metadata.get("spec")
    if not isinstance(model, str) or not isinstance(text, str):
        raise CorruptWeights('the metadata lack "model" or "spec"')
    spec = MappingSpec.from_json(text)
    _check_name(model)
    _check_name(spec.name)
    word = _word(metadata.get("word"), spec.k) if metadata["format"] == WORD_FORMAT else ()
    color_spec = _color_spec(metadata["color_spec"], spec) if "color_spec" in metadata else None
    dtype = _dtype(header)
    arrays = tensors.read(header, payload, list(_tensors(spec, color_spec, bool(word), dtype)))
    color = Color(color_spec, _from_tensors("color", color_spec, arrays)) if color_spec else None
    frame = Frame.from_json(metadata["frame"]) if "frame" in metadata else None
    loss = _loss(metadata["loss"]) if "loss" in metadata else None
    label = _label(metadata["label"]) if "label" in metadata else None
    return Weights(spec, _from_tensors("theta", spec, arrays), model, word, color, frame, dtype, loss, label)


def _color_spec(text: object, spec: MappingSpec) -> MappingSpec:
    """Read the color's spec and check that it fits the mapping function's."""
    if not isinstance(text, str):
        raise CorruptWeights('"color_spec" in the metadata is not a string')
    color_spec = MappingSpec.from_json(text)
    _check_name(color_spec.name)
    check_color_spec(spec, color_spec)
    return color_spec


def _dtype(header: dict[str, Any]) -> Dtype:
    """Return the type of theta in a file; float32 if the header names none that may be there."""
    theta = header.get("theta")
    name = theta.get("dtype") if isinstance(theta, dict) else None
    return next((dtype for dtype, type_ in TYPES.items() if type_ == name), "float32")


def _loss(text: object) -> Loss:
    """Read the loss in the metadata. Raises CorruptWeights."""
    try:
        fields = json.loads(text) if isinstance(text, str) else {}
        loss = Loss(float(fields["mean"]), float(fields["largest"]))
    except (ValueError, TypeError, KeyError, RecursionError, OverflowError) as error:
        raise CorruptWeights('"loss" is not a JSON object with the numbers "mean" and "largest"') from error
    if not (math.isfinite(loss.mean) and math.isfinite(loss.largest)):
        raise CorruptWeights('"loss" has a number that is not finite')
    return loss


def _tensors(spec: MappingSpec, color_spec: MappingSpec | None, is_word: bool, dtype: Dtype) -> Iterator[Tensors]:
    """Return the tensors that a file may have; in a word, 1 to k functions may have a color."""
    theta = _types("theta", spec, [spec.k] if is_word else [], dtype)
    if color_spec is None:
        yield theta
    elif is_word:
        yield from (theta | _types("color", color_spec, [colored], dtype) for colored in range(spec.k, 0, -1))
    else:
        yield theta | _types("color", color_spec, [], dtype)


def _types(name: str, spec: MappingSpec, rows: list[int], dtype: Dtype) -> Tensors:
    scales: Tensors = {f"{name}_scales": ("F32", [*rows, scales_of(spec)])} if dtype == "int8" else {}
    return scales | {name: (TYPES[dtype], [*rows, spec.size])}


def _to_tensors(name: str, spec: MappingSpec, weights: Array, dtype: Dtype) -> dict[str, Stored]:
    """Return the tensors of a function in a file."""
    match dtype:
        case "float32":
            return {name: weights}
        case "float16":
            return {name: close_float16(spec, weights)}
        case "int8":
            numbers, scales = to_int8(spec, weights)
            return {f"{name}_scales": scales, name: numbers}


def _from_tensors(name: str, spec: MappingSpec, arrays: Mapping[str, Stored]) -> Array:
    """Return the float32 weights that tensors of a file stand for."""
    scales = arrays.get(f"{name}_scales")
    return arrays[name].astype(np.float32) if scales is None else from_int8(spec, arrays[name], scales)


def _dump_safetensors(weights: Weights) -> bytes:
    spec, metadata = weights.spec, weights.labels
    arrays = _to_tensors("theta", spec, weights.theta, weights.dtype)
    if weights.dtype != "float32" and weights.frame:
        loss = loss_of(spec, weights.theta, _from_tensors("theta", spec, arrays), weights.frame)
        metadata |= {"loss": json.dumps(asdict(loss), separators=(",", ":"))}
    if weights.color:
        metadata |= {"color_spec": weights.color.spec.to_json()}
        arrays |= _to_tensors("color", weights.color.spec, weights.color.weights, weights.dtype)
    return tensors.pack(metadata, arrays)


def _word(text: object, k: int) -> tuple[str, ...]:
    """Read the word in a composed object's metadata: a JSON list of k names. Raises CorruptWeights."""
    try:
        word = json.loads(text) if isinstance(text, str) else None
    except (ValueError, RecursionError):
        word = None
    if not isinstance(word, list) or len(word) != k or not all(isinstance(name, str) for name in word):
        raise CorruptWeights(f'"word" in the metadata is not a list of {k} names')
    for name in word:
        _check_name(name)
    return tuple(word)


def _label(text: object) -> str | None:
    """Read the name that people gave the object. Raises CorruptWeights."""
    if not isinstance(text, str):
        raise CorruptWeights('"label" in the metadata is not a string')
    try:
        return clean_label(text)
    except InvalidParameter as error:
        raise CorruptWeights(f'"label" in the metadata: {error.detail}') from error


def _check_name(text: str) -> None:
    """Raise CorruptWeights unless a program's name can be shown and stored."""
    if not (0 < len(text) <= MAX_NAME and text.isprintable()):
        raise CorruptWeights(f"a name must have 1 to {MAX_NAME} printable characters")
