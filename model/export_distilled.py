"""Put distilled weights into an exported model: heads and color stay as they are (`hof-model distill`)."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
from onnx import helper, numpy_helper

from model.config import TrainConfig
from model.export import parity, round_matrices, write_checked
from model.networks.encoder import ImageEncoder
from service.encoding.encoder import Encoder

PREFIXES = ("encoder.", "")  # of the names of an encoder's weights, with a color head and without


def export_distilled(
    file: Path, encoder: ImageEncoder, config: TrainConfig, card: dict[str, Any], output: Path
) -> dict[str, float]:
    """Write an exported model with other weights of its encoder, whole or not at all.

    Returns
    -------
    The largest differences of `parity`.

    Raises
    ------
    ValueError : the file lacks a weight, or torch, onnxruntime and NumPy disagree by more than TOLERANCE.
    """
    round_matrices(encoder)
    model = onnx.load(file)
    stored = {each.name: each for each in model.graph.initializer}
    for name, weight in encoder.state_dict().items():
        _put(stored, name, weight.contiguous().numpy())
    entries = {entry.key: entry.value for entry in model.metadata_props}
    helper.set_model_props(model, entries | {"hof.card": json.dumps(card, ensure_ascii=False)})
    data = model.SerializeToString()
    differences = parity(encoder, config, Encoder(data, threads=1))
    write_checked(data, differences, output)
    return differences


def _put(stored: dict[str, onnx.TensorProto], name: str, weight: np.ndarray[Any, Any]) -> None:
    """Replace a stored weight, in the type that it has."""
    for source in (f"{prefix}{name}{end}" for prefix in PREFIXES for end in ("", ".float16")):
        if source in stored:
            own = numpy_helper.to_array(stored[source])
            stored[source].CopyFrom(numpy_helper.from_array(weight.astype(own.dtype), source))
            return
    raise ValueError(f"the model lacks the weight {name}, perhaps merged with an equal one")
