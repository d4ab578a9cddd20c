"""A tiny image encoder as ONNX, for tests.

theta is a linear function of the image's mean color, and so are the weights of the object's color and the estimates, if
it has any.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from service.mapping.spec import Array, MappingSpec, initial_theta

SPEC = MappingSpec("tiny", input_dim=3, hidden=(16,), output_dim=3, k=2)
COLOR_SPEC = MappingSpec("tiny colour", input_dim=3, hidden=(8,), output_dim=3)
SIZE = 32
COUNT = 256  # points of the encoder of points
CARD = {
    "name": "tiny-k2",
    "version": "1",
    "license": "CC0-1.0",
    "data": "none: its numbers are random",
    "figures": {"cd_epcg": None},
}


def metadata(
    spec: MappingSpec = SPEC, name: str = "tiny-k2", color_spec: MappingSpec | None = None, *, estimates: bool = False
) -> dict[str, str]:
    """Return the metadata that `hof-model export` writes beside the graph."""
    framing = {"size": SIZE, "foreground_ratio": 0.85}
    entries = {
        "hof.format": "1",
        "hof.spec": spec.to_json(),
        "hof.framing": json.dumps(framing),
        "hof.card": json.dumps(CARD | {"name": name}),
    }
    entries |= {"hof.color_spec": color_spec.to_json()} if color_spec else {}
    return entries | ({"hof.estimates": "1"} if estimates else {})


def parameters(spec: MappingSpec = SPEC) -> tuple[Array, Array]:
    """Return W (3, spec.size) and b (spec.size,) of theta = mean color @ W + b."""
    return np.stack([0.3 * initial_theta(spec, seed) for seed in (1, 2, 3)]), initial_theta(spec, 0)


def color_parameters(spec: MappingSpec = COLOR_SPEC) -> tuple[Array, Array]:
    """Return W and b of the color's weights: colors of all kinds, some of them clipped."""
    matrix, b = parameters(spec)
    b[-spec.output_dim :] += np.float32(0.5)
    return 3 * matrix, 3 * b


def estimate_parameters() -> dict[str, tuple[Array, Array]]:
    """Return W and b of each estimate: the confidence is the mean red; the camera's first angle grows with blue."""
    confidence = np.array([[1], [0], [0]], np.float32), np.zeros(1, np.float32)
    camera = np.array([[0, 0, 0, 0], [0, 30, 1, 5], [90, 0, 0, 0]], np.float32), np.array([0, 10, 2, -2], np.float32)
    return {"shape_confidence": confidence, "camera": camera}


def build(
    path: Path,
    spec: MappingSpec = SPEC,
    *,
    color_spec: MappingSpec | None = None,
    estimates: bool = False,
    meta: dict[str, str] | None = None,
    bias: float = 0.0,
    batch: str | int = "batch",
    output: str = "theta",
    trips: int = 0,
) -> Path:
    """Write the model.

    `color_spec` adds colors, `estimates` the estimates, `trips` the nodes of `_trouble`; the others spoil the file.
    """
    heads = {output: parameters(spec)} | ({"color": color_parameters(color_spec)} if color_spec else {})
    heads |= estimate_parameters() if estimates else {}
    outputs = {name: "plain" if trips and name == output else name for name in heads}
    nodes = [
        helper.make_node("GlobalAveragePool", ["image"], ["pooled"]),  # (b, 3, 1, 1)
        helper.make_node("Flatten", ["pooled"], ["mean"]),  # (b, 3)
        *(helper.make_node("Gemm", ["mean", f"{name}.W", f"{name}.b"], [outputs[name]]) for name in heads),  # (b, size)
        *(_trouble("plain", output) if trips else ()),
    ]
    tensors: dict[str, Any] = {f"{name}.W": matrix for name, (matrix, _) in heads.items()}
    tensors |= {f"{name}.b": b + np.float32(bias) for name, (_, b) in heads.items()}
    tensors |= _trouble_tensors(trips) if trips else {}
    graph = helper.make_graph(
        nodes,
        "tiny",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, [batch, 3, SIZE, SIZE])],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, [batch, len(b)]) for name, (_, b) in heads.items()],
        [numpy_helper.from_array(np.asarray(array), name) for name, array in tensors.items()],
    )
    model: Any = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    helper.set_model_props(model, metadata(spec, color_spec=color_spec, estimates=estimates) if meta is None else meta)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))
    return path


def build_points(path: Path, spec: MappingSpec = SPEC, name: str = "tiny-k2-points", count: int = COUNT) -> Path:
    """Write a tiny encoder of points: theta is a linear function of the points' mean squares."""
    matrix, b = parameters(spec)
    nodes = [
        helper.make_node("Mul", ["points", "points"], ["squares"]),
        helper.make_node("ReduceMean", ["squares"], ["mean"], axes=[1], keepdims=0),  # (b, 3)
        helper.make_node("Gemm", ["mean", "W", "b"], ["theta"]),
    ]
    graph = helper.make_graph(
        nodes,
        "tiny points",
        [helper.make_tensor_value_info("points", TensorProto.FLOAT, ["batch", count, 3])],
        [helper.make_tensor_value_info("theta", TensorProto.FLOAT, ["batch", len(b)])],
        [numpy_helper.from_array(matrix, "W"), numpy_helper.from_array(b, "b")],
    )
    model: Any = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    entries = metadata(spec, name)
    del entries["hof.framing"]
    helper.set_model_props(model, entries | {"hof.points": json.dumps({"count": count})})
    onnx.checker.check_model(model)
    onnx.save(model, str(path))
    return path


def _trouble(plain: str, output: str) -> list[Any]:
    """Return nodes that make the network slow for dark images, and fail for those without blue.

    An empty loop runs `trips` times if a batch's darkest channel is black, and not at all if it is white.
    theta is not finite where the mean blue is below 0.1.
    """
    body = helper.make_graph(
        [
            helper.make_node("Identity", ["on_in"], ["on_out"]),
            helper.make_node("Identity", ["state_in"], ["state_out"]),
        ],
        "nothing",
        [
            helper.make_tensor_value_info("trip", TensorProto.INT64, []),
            helper.make_tensor_value_info("on_in", TensorProto.BOOL, []),
            helper.make_tensor_value_info("state_in", TensorProto.FLOAT, []),
        ],
        [
            helper.make_tensor_value_info("on_out", TensorProto.BOOL, []),
            helper.make_tensor_value_info("state_out", TensorProto.FLOAT, []),
        ],
    )
    return [
        helper.make_node("ReduceMin", ["mean"], ["darkest"], keepdims=0),
        helper.make_node("Mul", ["darkest", "trips"], ["spared"]),
        helper.make_node("Sub", ["trips", "spared"], ["turns"]),
        helper.make_node("Cast", ["turns"], ["count"], to=TensorProto.INT64),
        helper.make_node("Loop", ["count", "on", "zero"], ["nothing"], body=body),
        helper.make_node("Gather", ["mean", "blue"], ["b_mean"], axis=1),  # (b,)
        helper.make_node("Sub", ["b_mean", "tenth"], ["above"]),
        helper.make_node("Sqrt", ["above"], ["root"]),
        helper.make_node("Mul", ["root", "nothing"], ["nothing_or_nan"]),
        helper.make_node("Unsqueeze", ["nothing_or_nan", "last"], ["column"]),  # (b, 1)
        helper.make_node("Add", [plain, "column"], [output]),
    ]


def _trouble_tensors(trips: int) -> dict[str, Any]:
    """Return the constants of `_trouble`, by name."""
    loop = {"trips": np.float32(trips), "zero": np.float32(0), "on": np.bool_(True)}
    return loop | {"blue": np.int64(2), "tenth": np.float32(0.1), "last": np.array([1], np.int64)}


def theta_of(tensor: Array, spec: MappingSpec = SPEC) -> Array:
    """Return the model's right answer: (b, 3, S, S) -> (b, spec.size)."""
    matrix, b = parameters(spec)
    theta: Array = tensor.mean(axis=(2, 3)) @ matrix + b
    return theta
