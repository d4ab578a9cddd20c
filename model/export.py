"""Export an encoder to one ONNX file with its spec, framing and card, compressed and checked.

Matrices are stored as float16 and computed in float32, which halves the file. The torch encoder gets the same
rounded numbers before the two are compared.
"""

import json
import tempfile
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np
import onnx
import torch
from onnx import helper, numpy_helper
from torch import Tensor, nn

from model.config import TrainConfig
from model.networks.color_head import ColoredEncoder, ColorHead
from model.networks.encoder import ImageEncoder
from model.networks.estimate_heads import EstimateHeads
from model.networks.inner import InnerEncoder, inner_tensors
from model.networks.mapping import power
from service import mapping
from service.encoding.clouds import MOST_POINTS
from service.encoding.encoder import FORMAT, Encoder
from service.encoding.estimates import OUTPUTS, VERSION
from service.files import whole_file
from service.mapping.canonical import canonical_points
from service.mapping.sampler import Sampler

OPSET: Final = 17
TOLERANCE: Final = 1e-4  # on theta and points, absolute
PARITY_IMAGES: Final = 8
PARITY_POINTS: Final = 2_000
HEADS: Final = "estimates/"  # prefix of the names of the heads' nodes and weights
HEADS_TOLERANCE: Final = {  # theta and color must not change at all
    "theta: file - file": 0.0,
    "color: file - file": 0.0,
    "shape_confidence: torch - onnxruntime": 1e-3,
    "camera: torch - onnxruntime": 0.05,  # degrees, longest sides
}


def export(
    encoder: ImageEncoder, config: TrainConfig, card: dict[str, Any], output: Path, color: ColorHead | None = None
) -> dict[str, float]:
    """Write `output`, whole or not at all, and return the largest differences of `parity` and `color_parity`.

    Parameters
    ----------
    card : the model card; the service requires its `name`.
    color : color head; the file then has a second output `color`. It does not change theta.

    Raises
    ------
    ValueError : torch, onnxruntime and NumPy disagree by more than TOLERANCE.
    """
    network = ColoredEncoder(encoder, color) if color else encoder
    round_matrices(network)
    inputs = torch.from_numpy(_random_inputs(config, 0)[:1])
    name = "points" if config.encoder.takes_points else "image"
    graph = halve(_exported(network, (inputs,), [name], ["theta", *(["color"] if color else [])]))
    for key, value in _metadata(config, card, color).items():
        entry = graph.metadata_props.add()
        entry.key, entry.value = key, value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    data = graph.SerializeToString()
    exported = Encoder(data, threads=1)
    differences = parity(encoder, config, exported)
    if color:
        differences |= color_parity(ColoredEncoder(encoder, color), config, exported)
    write_checked(data, differences, output)
    return differences


def write_checked(data: bytes, differences: Mapping[str, float], output: Path) -> None:
    """Write an exported encoder, whole or not at all.

    Raises
    ------
    ValueError : torch, onnxruntime and NumPy disagree by more than TOLERANCE.
    """
    if max(differences.values()) > TOLERANCE:
        raise ValueError(f"torch, onnxruntime and NumPy disagree: {differences}, the limit is {TOLERANCE}")
    output.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(output) as file:
        file.write(data)


def _metadata(config: TrainConfig, card: dict[str, Any], color: ColorHead | None) -> dict[str, str | dict[str, Any]]:
    """Return what the service reads beside the network: texts, and objects that are written as JSON."""
    is_of_points = config.encoder.takes_points
    sees = {"hof.points": {"count": MOST_POINTS}} if is_of_points else {"hof.framing": asdict(config.framing)}
    texts = {"hof.format": str(FORMAT), "hof.spec": config.spec.to_json()}
    color_spec = {"hof.color_spec": color.spec.to_json()} if color else {}
    return {**texts, "hof.card": card, **sees, **color_spec}


@torch.no_grad()
def parity(encoder: ImageEncoder, config: TrainConfig, exported: Encoder, seed: int = 0) -> dict[str, float]:
    """Return the largest differences, over random images, of theta and points.

    Theta is compared between torch and onnxruntime; points between torch, the NumPy reference and `Sampler`.
    """
    spec = config.spec
    images = _random_inputs(config, seed)
    theta = encoder(torch.from_numpy(images))
    theta_ort = np.stack([functions.theta for functions in exported.encode(images)])
    canonical = canonical_points(spec.domain, PARITY_POINTS, seed)
    points = power(spec, theta, torch.from_numpy(canonical).expand(PARITY_IMAGES, -1, -1)).numpy()
    reference = np.stack([mapping.power(spec, row, canonical) for row in theta_ort])
    words = (mapping.word_of(spec, row) for row in theta_ort)
    sampled = np.stack([Sampler(spec, word).points(PARITY_POINTS, seed=seed) for word in words])
    return {
        "theta: torch - onnxruntime": float(np.abs(theta.numpy() - theta_ort).max()),
        "points: torch - NumPy": float(np.abs(points - reference).max()),
        "points: torch - sampler": float(np.abs(points - sampled).max()),
    }


@torch.no_grad()
def color_parity(network: ColoredEncoder, config: TrainConfig, exported: Encoder, seed: int = 0) -> dict[str, float]:
    """Return the largest differences, over random images, of color weights and of colors in [0, 1].

    Weights are compared between torch and onnxruntime; colors between torch and the NumPy reference.
    """
    images = _random_inputs(config, seed)
    weights = network(torch.from_numpy(images))[1]
    weights_ort = np.stack([functions.color.weights for functions in exported.encode(images) if functions.color])
    spec, canonical = network.head.spec, canonical_points(config.spec.domain, PARITY_POINTS, seed)
    colors = power(spec, weights, torch.from_numpy(canonical).expand(PARITY_IMAGES, -1, -1)).numpy()
    reference = np.stack([mapping.power(spec, row, canonical) for row in weights_ort])
    return {
        "color: torch - onnxruntime": float(np.abs(weights.numpy() - weights_ort).max()),
        "colors: torch - NumPy": float(np.abs(colors.clip(0, 1) - reference.clip(0, 1)).max()),
    }


def attach(file: Path, heads: EstimateHeads, card: dict[str, Any], output: Path) -> dict[str, float]:
    """Write an exported model with heads as further outputs; theta and color stay the same numbers.

    Parameters
    ----------
    file : an encoder that `export` wrote, with heads or without.
    card : the model card of the new file.

    Returns
    -------
    The largest differences, over random images, of the outputs: old and new file, torch and onnxruntime.

    Raises
    ------
    ValueError : a difference is above its limit.
    """
    model = onnx.load(file)
    _detach(model.graph)
    tensors = inner_tensors(model)
    round_matrices(heads)
    _append(model.graph, halve(_heads_to_onnx(heads, InnerEncoder(file, threads=1))), tensors)
    entries = {entry.key: entry.value for entry in model.metadata_props}
    entries |= {"hof.estimates": VERSION, "hof.card": json.dumps(card, ensure_ascii=False)}
    helper.set_model_props(model, entries)
    onnx.checker.check_model(model)
    data = model.SerializeToString()
    differences = _heads_parity(file, heads, Encoder(data, threads=1))
    if any(differences[name] > limit for name, limit in HEADS_TOLERANCE.items()):
        raise ValueError(f"the files or torch disagree: {differences}, the limits are {HEADS_TOLERANCE}")
    with whole_file(output) as target:
        target.write(data)
    return differences


def _detach(graph: onnx.GraphProto) -> None:
    """Remove the heads that `attach` added before."""
    for field in (graph.node, graph.initializer, graph.output):
        kept = [each for each in field if not each.name.startswith(HEADS) and each.name not in OUTPUTS]
        del field[:]
        field.extend(kept)


def _heads_to_onnx(heads: EstimateHeads, encoder: InnerEncoder) -> onnx.ModelProto:
    """Return the heads as a graph whose inputs have the names of the inner tensors."""
    size = encoder.size
    inner = encoder.look(np.zeros((1, 3, size, size), np.float32))[1]
    tensors = tuple(torch.from_numpy(inner[name]) for name in heads.names)
    return _exported(heads, tensors, heads.names, tuple(OUTPUTS))


def _append(graph: onnx.GraphProto, heads: onnx.ModelProto, tensors: Mapping[str, str]) -> None:
    """Append the graph of heads; its inputs become the encoder's inner tensors, its other names get a prefix."""

    def rename(name: str) -> str:
        return tensors.get(name) or (name if name in ("", *OUTPUTS) else HEADS + name)

    for initializer in heads.graph.initializer:
        initializer.name = rename(initializer.name)
        graph.initializer.append(initializer)
    for node in heads.graph.node:
        names = [rename(name) for name in node.input], [rename(name) for name in node.output]
        node.name = HEADS + node.output[0]  # names must differ; casts have none
        del node.input[:], node.output[:]
        node.input.extend(names[0])
        node.output.extend(names[1])
        graph.node.append(node)
    for name, shape in OUTPUTS.items():
        graph.output.append(helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, ["batch", *shape]))


@torch.no_grad()
def _heads_parity(file: Path, heads: EstimateHeads, attached: Encoder) -> dict[str, float]:
    """Return the largest differences of outputs over random images; of azimuths the shorter way around."""
    before, inner = Encoder.open(file, threads=1), InnerEncoder(file, threads=1)
    size = before.framing.size
    images = np.random.default_rng(0).random((PARITY_IMAGES, 3, size, size), np.float32)
    pairs = list(zip(before.encode(images), attached.encode(images), strict=True))
    theta = max(float(np.abs(old.theta - new.theta).max()) for old, new in pairs)
    colors = [
        float(np.abs(old.color.weights - new.color.weights).max()) for old, new in pairs if old.color and new.color
    ]
    tensors = inner.look(images)[1]
    confidence, camera = heads(*(torch.from_numpy(tensors[name]) for name in heads.names))
    estimates = [new.estimates for _, new in pairs if new.estimates]
    cameras = np.array([list(vars(each.camera).values()) for each in estimates])
    away = np.abs(cameras - camera.numpy())
    away[:, 0] = np.minimum(away[:, 0], 360 - away[:, 0])
    confidences = np.array([each.shape_confidence for each in estimates])
    return {
        "theta: file - file": theta,
        "color: file - file": max(colors, default=0.0),
        "shape_confidence: torch - onnxruntime": float(np.abs(confidences - confidence.numpy()[:, 0]).max()),
        "camera: torch - onnxruntime": float(away.max()),
    }


def _random_inputs(config: TrainConfig, seed: int) -> mapping.Array:
    """Return PARITY_IMAGES images of noise, (b, 3, size, size) in [0, 1], or clouds of it, (b, MOST_POINTS, 3)."""
    if config.encoder.takes_points:
        return np.random.default_rng(seed).random((PARITY_IMAGES, MOST_POINTS, 3), np.float32) - np.float32(0.5)
    side = config.framing.size
    return np.random.default_rng(seed).random((PARITY_IMAGES, 3, side, side), np.float32)


@torch.no_grad()
def round_matrices(network: nn.Module) -> None:
    """Round every matrix and kernel to float16; vectors keep float32."""
    for parameter in network.parameters():
        if parameter.dim() > 1:
            parameter.copy_(parameter.half().float())


def to_onnx(network: nn.Module, size: int, *outputs: str) -> onnx.ModelProto:
    """Return a network of images (b, 3, size, size) as a graph with the input `image` and the named outputs."""
    return _exported(network, (torch.zeros(1, 3, size, size),), ["image"], outputs)


def _exported(
    network: nn.Module, inputs: tuple[Tensor, ...], names: Sequence[str], outputs: Sequence[str]
) -> onnx.ModelProto:
    """Return a network as a graph with named inputs and outputs, the batch's size open."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        # torch's newer exporter needs another package and gives no better file here
        warnings.simplefilter("ignore", DeprecationWarning)
        warnings.filterwarnings("ignore", "Constant folding")  # of paddings, which onnxruntime folds
        path = Path(folder) / "network.onnx"
        torch.onnx.export(
            network.eval(),
            inputs,
            path,
            input_names=list(names),
            output_names=list(outputs),
            dynamic_axes={name: {0: "batch"} for name in (*names, *outputs)},
            opset_version=OPSET,
            dynamo=False,
        )
        return onnx.load(path)


def halve(graph: onnx.ModelProto) -> onnx.ModelProto:
    """Store matrices as float16, each behind a cast to float32 that onnxruntime folds at start."""
    casts = []
    for initializer in graph.graph.initializer:
        if initializer.data_type != onnx.TensorProto.FLOAT or len(initializer.dims) < 2:
            continue
        name = initializer.name
        half = numpy_helper.from_array(numpy_helper.to_array(initializer).astype(np.float16), f"{name}.float16")
        initializer.CopyFrom(half)
        casts.append(helper.make_node("Cast", [half.name], [name], to=onnx.TensorProto.FLOAT))
    for cast in reversed(casts):
        graph.graph.node.insert(0, cast)
    onnx.checker.check_model(graph)
    return graph
