"""Ways to evaluate a network on a CPU core, each in the best form we know; all take a tile size.

Every way is `make(network, tile) -> evaluate`, and `evaluate` maps (n, input) float32 to (n, output).
"""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
import onnx
import onnxruntime as ort
import torch
from onnx import TensorProto, helper, numpy_helper

from benchmarks.speed.networks import Network
from service.mapping.spec import Activation, Array

Evaluate = Callable[[Array], Array]
Make = Callable[[Network, int], Evaluate]


def naive(network: Network, tile: int) -> Evaluate:
    """NumPy on whole arrays, without tiles."""
    return network.reference


def numpy_tiles(network: Network, tile: int) -> Evaluate:
    """NumPy as in the service's sampler: tiles, reused buffers, biases folded in by a row of ones."""
    width = network.layers[0].w.shape[1]
    x = np.ones((width + 1, tile), np.float32)
    steps: list[tuple[Array, Array, Array, Activation | None, Array | None]] = []
    before = x
    for layer in network.layers:
        rows = len(layer.w)
        after = np.ones((rows + 1, tile), np.float32)
        matrix = np.concatenate([layer.w, layer.b[:, None]], axis=1)
        joined = np.ones((matrix.shape[1], tile), np.float32) if layer.skip else None
        steps.append((matrix, before, after, layer.activation, joined))
        before = after
    zeros = np.zeros((max(len(layer.w) for layer in network.layers), tile), np.float32)
    out_rows = len(network.layers[-1].w)

    def evaluate(points: Array) -> Array:
        out = np.empty((len(points), out_rows), np.float32)
        for start in range(0, len(points), tile):
            part = points[start : start + tile]
            x[:-1, : len(part)] = part.T
            for matrix, source, target, activation, joined in steps:
                if joined is not None:
                    joined[: len(source) - 1], joined[len(source) - 1 : -1] = source[:-1], x[:-1]
                    source = joined
                result = target[:-1]
                np.matmul(matrix, source, out=result)
                if activation == "relu":
                    np.maximum(result, zeros[: len(result)], out=result)
                elif activation:
                    np.tanh(result, out=result)
            out[start : start + tile] = steps[-1][2][:-1, : len(part)].T
        return out

    return evaluate


def onnxruntime(network: Network, tile: int) -> Evaluate:
    """onnxruntime, one thread, all graph optimizations."""
    options = ort.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = ort.InferenceSession(_onnx(network), options, providers=["CPUExecutionProvider"])

    def run(points: Array) -> Array:
        result: Array = session.run(None, {"x": points})[0]
        return result

    return _tile(run, tile)


def torch_eager(network: Network, tile: int) -> Evaluate:
    """PyTorch without a compiler: addmm, and ReLU or tanh in place."""
    forward = _torch_forward(network)

    @torch.inference_mode()
    def run(points: Array) -> Array:
        result: Array = forward(torch.from_numpy(points)).numpy()
        return result

    return _tile(run, tile)


def torch_compiled(network: Network, tile: int) -> Evaluate:
    """PyTorch's compiler on tiles of a fixed size."""
    plain: Any = _torch_forward(network)
    plain.__code__ = plain.__code__.replace()  # a code object of its own: the compiler counts versions by it
    forward: Any = torch.compile(plain, fullgraph=True, dynamic=False)

    @torch.inference_mode()
    def run(points: Array) -> Array:
        result: Array = forward(torch.from_numpy(points)).numpy()
        return result

    return _tile(_pad(run, tile), tile)


def jax_jit(network: Network, tile: int) -> Evaluate:
    """JAX, compiled for tiles of a fixed size."""
    import jax  # the extra `bench`; the tests do without
    import jax.numpy as jnp

    weights = [(jnp.asarray(layer.w.T), jnp.asarray(layer.b)) for layer in network.layers]

    def forward(x: jax.Array) -> jax.Array:
        y = x
        for (w, b), layer in zip(weights, network.layers, strict=True):
            y = (jnp.concatenate([y, x], axis=1) if layer.skip else y) @ w + b
            if layer.activation:
                y = jnp.maximum(y, 0) if layer.activation == "relu" else jnp.tanh(y)
        return y

    compiled = jax.jit(forward)
    return _tile(_pad(lambda points: np.asarray(compiled(points)), tile), tile)


RIVALS: Final[dict[str, Make]] = {
    "naive NumPy": naive,
    "onnxruntime": onnxruntime,
    "torch eager": torch_eager,
    "torch compiled": torch_compiled,
    "JAX": jax_jit,
}


def _tile(run: Evaluate, tile: int) -> Evaluate:
    def evaluate(points: Array) -> Array:
        parts = [run(points[start : start + tile]) for start in range(0, len(points), tile)]
        return np.concatenate(parts)

    return evaluate


def _pad(run: Evaluate, tile: int) -> Evaluate:
    """Pad the points so that every call has `tile` of them, for compilers."""

    def evaluate(points: Array) -> Array:
        if len(points) == tile:
            return run(points)
        full = np.zeros((tile, points.shape[1]), np.float32)
        full[: len(points)] = points
        return run(full)[: len(points)]

    return evaluate


def _torch_forward(network: Network) -> Callable[[torch.Tensor], torch.Tensor]:
    weights = [
        (torch.from_numpy(np.ascontiguousarray(layer.w.T)), torch.from_numpy(layer.b)) for layer in network.layers
    ]

    def forward(x: torch.Tensor) -> torch.Tensor:
        y = x
        for (w, b), layer in zip(weights, network.layers, strict=True):
            y = torch.addmm(b, torch.cat([y, x], dim=1) if layer.skip else y, w)
            if layer.activation:
                y = y.relu_() if layer.activation == "relu" else y.tanh_()
        return y

    return forward


def _onnx(network: Network) -> bytes:
    nodes, initializers, y = [], [], "x"
    for index, layer in enumerate(network.layers):
        if layer.skip:
            nodes.append(helper.make_node("Concat", [y, "x"], [f"joined{index}"], axis=1))
            y = f"joined{index}"
        initializers += [numpy_helper.from_array(layer.w, f"w{index}"), numpy_helper.from_array(layer.b, f"b{index}")]
        nodes.append(helper.make_node("Gemm", [y, f"w{index}", f"b{index}"], [f"y{index}"], transB=1))
        y = f"y{index}"
        if layer.activation:
            kind = {"relu": "Relu", "tanh": "Tanh"}[layer.activation]
            nodes.append(helper.make_node(kind, [y], [f"hidden{index}"]))
            y = f"hidden{index}"
    inputs = helper.make_tensor_value_info("x", TensorProto.FLOAT, ["n", network.layers[0].w.shape[1]])
    outputs = helper.make_tensor_value_info(y, TensorProto.FLOAT, ["n", len(network.layers[-1].w)])
    graph = helper.make_graph(nodes, "network", [inputs], [outputs], initializers)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.checker.check_model(model)
    data: bytes = model.SerializeToString()
    return data
