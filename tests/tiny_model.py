"""A tiny image encoder as ONNX, for tests: theta is a linear function of the image's mean colour."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from service.mapping import Array, MappingSpec, initial_theta

SPEC = MappingSpec("tiny", input_dim=3, hidden=(16,), output_dim=3, k=2)
SIZE = 32
CARD = {
    "name": "tiny-k2",
    "version": "1",
    "license": "CC0-1.0",
    "data": "none: its numbers are random",
    "figures": {"cd_epcg": None},
}


def metadata(spec: MappingSpec = SPEC, name: str = "tiny-k2") -> dict[str, str]:
    """What `hof-model export` writes beside the graph."""
    framing = {"size": SIZE, "foreground_ratio": 0.85}
    return {
        "hof.spec": spec.to_json(),
        "hof.framing": json.dumps(framing),
        "hof.card": json.dumps(CARD | {"name": name}),
    }


def parameters(spec: MappingSpec = SPEC) -> tuple[Array, Array]:
    """W (3, spec.size) and b (spec.size,) of theta = mean colour @ W + b."""
    return np.stack([0.3 * initial_theta(spec, seed) for seed in (1, 2, 3)]), initial_theta(spec, 0)


def build(
    path: Path,
    spec: MappingSpec = SPEC,
    *,
    meta: dict[str, str] | None = None,
    bias: float = 0.0,
    batch: str | int = "batch",
    output: str = "theta",
) -> Path:
    """Write the model; the keywords make it wrong in one way each."""
    matrix, b = parameters(spec)
    nodes = [
        helper.make_node("GlobalAveragePool", ["image"], ["pooled"]),  # (b, 3, 1, 1)
        helper.make_node("Flatten", ["pooled"], ["colour"]),  # (b, 3)
        helper.make_node("Gemm", ["colour", "W", "b"], [output]),  # (b, spec.size)
    ]
    graph = helper.make_graph(
        nodes,
        "tiny",
        [helper.make_tensor_value_info("image", TensorProto.FLOAT, [batch, 3, SIZE, SIZE])],
        [helper.make_tensor_value_info(output, TensorProto.FLOAT, [batch, matrix.shape[1]])],
        [numpy_helper.from_array(matrix, "W"), numpy_helper.from_array(b + np.float32(bias), "b")],
    )
    model: Any = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    helper.set_model_props(model, metadata(spec) if meta is None else meta)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))
    return path


def theta_of(tensor: Array, spec: MappingSpec = SPEC) -> Array:
    """What the model must answer: (b, 3, S, S) -> (b, spec.size)."""
    matrix, b = parameters(spec)
    theta: Array = tensor.mean(axis=(2, 3)) @ matrix + b
    return theta
