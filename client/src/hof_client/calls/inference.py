"""Calls of the Open Inference Protocol, version 2: prepared images to weights."""

import json
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from hof_client.answers import Array
from hof_client.bodies import Whole, json_reader
from hof_client.inference_answers import InferenceModel, InferenceServer, Live, ModelConfig, ModelReady, ServerReady
from hof_client.request import Call, Request

HEADER_LENGTH = "Inference-Header-Content-Length"


def inference_server() -> Call[InferenceServer]:
    """Return the service's name, version and protocol extensions."""
    return Call(Request("GET", "/v2"), json_reader(InferenceServer))


def inference_live() -> Call[Live]:
    """Show that the process answers."""
    return Call(Request("GET", "/v2/health/live"), json_reader(Live))


def inference_ready() -> Call[ServerReady]:
    """Show that the service can serve. Raises NotReady."""
    return Call(Request("GET", "/v2/health/ready"), json_reader(ServerReady))


def inference_model(name: str, *, version: str | None = None) -> Call[InferenceModel]:
    """Return a model's tensors. Raises NotFound for a model that is not loaded, or a version other than 1."""
    return Call(_about(name, version), json_reader(InferenceModel))


def inference_config(name: str, *, version: str | None = None) -> Call[ModelConfig]:
    """Return a model's configuration, as Triton's clients read it. Raises NotFound."""
    return Call(_about(name, version, "/config"), json_reader(ModelConfig))


def inference_model_ready(name: str, *, version: str | None = None) -> Call[ModelReady]:
    """Show that a model can serve. Raises NotFound or NotReady."""
    return Call(_about(name, version, "/ready"), json_reader(ModelReady))


def infer(name: str, images: Array, *, version: str | None = None) -> Call[dict[str, Array]]:
    """Turn one to eight prepared images into weights; nothing is kept. Tensors travel as bytes.

    Parameters
    ----------
    images : (b, 3, size, size) float32: planes of red, green and blue in [0, 1], rows from the top, the object
        centered on white. `model` tells the size and the share of the square that the object fills.

    Returns
    -------
    Outputs by name, (b, numbers) float32: `theta`, and `color` if the model has color.

    Raises
    ------
    InvalidParameter, NotFound : see `hof_client.problems`.
    """
    body = np.ascontiguousarray(images, "<f4")
    tensor = {"name": "image", "shape": body.shape, "datatype": "FP32", "parameters": {"binary_data_size": body.nbytes}}
    header = json.dumps({"inputs": [tensor], "parameters": {"binary_data_output": True}}).encode()
    about = _about(name, version, "/infer")
    request = Request(
        "POST",
        about.template,
        about.places,
        content=header + body.tobytes(),
        headers={HEADER_LENGTH: str(len(header)), "Content-Type": "application/octet-stream"},
        media_type="application/octet-stream",
    )
    return Call(request, lambda headers: Whole(partial(_outputs, headers.get(HEADER_LENGTH, ""))))


def _about(name: str, version: str | None, of: str = "") -> Request:
    if version is None:
        return Request("GET", "/v2/models/{name}" + of, {"name": name})
    return Request("GET", "/v2/models/{name}/versions/{version}" + of, {"name": name, "version": version})


def _outputs(header_length: str, body: bytes) -> dict[str, Array]:
    """Return the tensors of a binary answer. Raises ValueError."""
    start = int(header_length)
    header: Mapping[str, Any] = json.loads(body[:start])
    outputs: Sequence[Mapping[str, Any]] = header["outputs"]
    arrays = {}
    for output in outputs:
        end = start + output["parameters"]["binary_data_size"]
        arrays[output["name"]] = np.frombuffer(body[start:end], "<f4").reshape(output["shape"]).astype(np.float32)
        start = end
    return arrays
