"""A mapping function as an ONNX file: x (n, input_dim) -> points (n, 3), all k applications and the frame included.

An ONNX file is one Protocol Buffers message: fields, each with a number, a wire type and a value
(https://protobuf.dev/programming-guides/encoding). The few fields that the graph needs, numbered as in ONNX's
onnx.proto, are written by hand, so that the service does not depend on the onnx package.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np

from service.mapping.frame import Frame
from service.mapping.spec import Array, MappingSpec, layers, word_of

IR_VERSION: Final = 8
OPSET: Final = 13
FLOAT: Final = 1  # TensorProto.FLOAT
INT: Final = 2  # AttributeProto.INT
VARINT, BYTES = 0, 2  # wire types

Field = tuple[int, int | str | bytes]


def dump(spec: MappingSpec, theta: Array, metadata: Mapping[str, str], frame: Frame | None = None) -> bytes:
    """Write the file of f^k, or of a word.

    Parameters
    ----------
    theta : float32 (spec.size,), or (spec.k, spec.size) for a word.
    metadata : written to the model's `metadata_props`.
    frame : the object's box, which the file centers and scales to length 1; None for the function's own numbers.
    """
    return _message(
        (1, IR_VERSION),
        (2, "hof"),  # producer_name
        (7, _graph(spec, theta, frame)),
        (8, _message((1, ""), (2, OPSET))),  # opset_import: domain, version
        *((14, _message((1, key), (2, value))) for key, value in metadata.items()),
    )


def _graph(spec: MappingSpec, theta: Array, frame: Frame | None) -> bytes:
    nodes: list[bytes] = []
    tensors: dict[str, bytes] = {}
    names: dict[bytes, str] = {}  # in a word AAB, the tensors of A are stored once
    source = "x"
    for step, function in enumerate(reversed(word_of(spec, theta)), 1):
        name = names.setdefault(function.tobytes(), f"f{len(names)}")
        for layer, (w, b) in enumerate(layers(spec, function), 1):
            weight, bias, result = f"{name}.W{layer}", f"{name}.b{layer}", f"step{step}.layer{layer}"
            tensors |= {weight: _tensor(weight, w), bias: _tensor(bias, b)}
            nodes.append(_node("Gemm", [source, weight, bias], result, _TRANSPOSE))
            source = result
            if layer < len(spec.shapes):
                source = f"{result}.{spec.activation}"
                nodes.append(_node(spec.activation.capitalize(), [result], source))
    if frame:
        tensors |= {"center": _tensor("center", frame.center), "factor": _tensor("factor", np.array([frame.factor()]))}
        nodes.append(_node("Sub", [source, "center"], "centered"))
        nodes.append(_node("Mul", ["centered", "factor"], "points"))
    else:
        nodes.append(_node("Identity", [source], "points"))
    return _message(
        *((1, node) for node in nodes),
        (2, "mapping function"),
        *((5, tensor) for tensor in tensors.values()),
        (11, _value("x", spec.input_dim)),
        (12, _value("points", spec.output_dim)),
    )


def _node(operator: str, inputs: list[str], output: str, *attributes: bytes) -> bytes:
    """Return a NodeProto."""
    return _message(*((1, name) for name in inputs), (2, output), (4, operator), *((5, each) for each in attributes))


def _tensor(name: str, array: Array) -> bytes:
    """Return a TensorProto."""
    data = np.ascontiguousarray(array, dtype="<f4").tobytes()
    return _message(*((1, size) for size in array.shape), (2, FLOAT), (8, name), (9, data))


def _value(name: str, columns: int) -> bytes:
    """Return a ValueInfoProto: float32 (n, columns), n left open."""
    shape = _message((1, _message((2, "n"))), (1, _message((1, columns))))
    return _message((1, name), (2, _message((1, _message((1, FLOAT), (2, shape))))))


def _message(*fields: Field) -> bytes:
    """Encode fields in order; a nested message is a field of bytes."""
    return b"".join(_field(number, value) for number, value in fields)


def _field(number: int, value: int | str | bytes) -> bytes:
    """Encode one field: a varint, or a length and bytes."""
    if isinstance(value, int):
        return _varint(number << 3 | VARINT) + _varint(value)
    data = value.encode() if isinstance(value, str) else value
    return _varint(number << 3 | BYTES) + _varint(len(data)) + data


def _varint(value: int) -> bytes:
    """Encode an integer in groups of seven bits, lowest first; a set high bit means that more bytes follow."""
    groups = bytearray()
    while value >= 0x80:
        groups.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*groups, value])


_TRANSPOSE: Final = _message((1, "transB"), (3, 1), (20, INT))  # Gemm then computes x @ W.T + b
