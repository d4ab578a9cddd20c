"""Hooks for Schemathesis: constraints of valid requests that a JSON schema cannot express, and short answers.

They run before each request. Requests that are meant to be invalid stay as they are.
"""

import json
import zlib
from typing import Any

import httpx
import schemathesis

from service.formats.weights import Weights, dump
from service.mapping.spec import initial_theta
from tests.support.photos import disc, image_file
from tests.support.small import model as tiny_model

MOST_POINTS = 1_000  # JSON holds no 10,000,000
MOST_OFFSET = 2**31  # a Sobol sequence ends at 2^32
VIEWS = ("GET /objects/{id}/points", "GET /objects/{id}/mesh")
CAMERA = {"azimuth": 30, "elevation": 20, "distance": 3, "roll": 0}


@schemathesis.hook
def before_call(context: schemathesis.HookContext, case: schemathesis.Case[Any], kwargs: dict[str, Any]) -> None:
    """Correct a request that is meant to be valid."""
    if case.meta is None or not case.meta.generation.mode.is_positive:
        return
    query = case.query
    if "model" in query:
        query["model"] = tiny_model.CARD["name"]
    query.pop("cursor", None)  # only what a page gave is one
    if "n" in query:
        query["n"] = min(int(query["n"]), MOST_POINTS)
    if query.get("sampling") == "sobol" and "offset" in query:
        query["offset"] = min(int(query["offset"]), MOST_OFFSET)
    if case.operation.label in VIEWS:
        _complete_camera(query)
    if case.operation.label == "POST /compose" and (word := _word(case.operation.base_url)):
        case.body = {**case.body, "objects": word}  # type: ignore[dict-item]
    if case.operation.label == "GET /objects/{id}/picture" and query.get("frames", 1) != 1:
        query |= {"size": 64, "format": "gif"}
    if query.get("format", "safetensors") != "safetensors":
        query.pop("dtype", None)
    if case.operation.label == "POST /objects/{id}/path":
        case.body = {**case.body, **_ends(case.body)}  # type: ignore[dict-item]
    if case.operation.label == "GET /objects/{id}/photo":
        case.path_parameters = {"id": _id_with_photo(case.operation.base_url)}
    if case.operation.label in BODIES:
        number = zlib.crc32(repr(case.body).encode()) % 100
        case.media_type, kwargs["data"] = BODIES[case.operation.label](number, case.media_type)


def _complete_camera(query: dict[str, Any]) -> None:
    """Give `frame=camera` a whole camera, for objects that have none, and other frames no camera."""
    for name in ("fx", "fy", "cx", "cy"):  # these need the object's photo
        query.pop(name, None)
    for name, value in CAMERA.items():
        if query.get("frame") == "camera":
            query.setdefault(name, value)
        else:
            query.pop(name, None)


def _id_with_photo(url: str) -> str:
    """Return the id of a stored object whose photo is kept."""
    answer = httpx.post(url + "encode", params={"keep_photo": True}, content=image_file(disc("green")))
    id_: str = answer.json()["id"]
    return id_


def _word(url: str) -> list[str]:
    """Return the ids of two stored objects that are not composed; none if there are fewer."""
    items = httpx.get(url + "objects", params={"limit": 500}).json()["items"]
    ids = [item["id"] for item in items if item["kind"] != "composed"]
    return ids[:2] if len(ids) > 1 else []


def _ends(body: Any) -> dict[str, object]:  # noqa: ANN401 - any JSON
    """Return ends of a path that every object leaves free: corners of the cube, in the object frame."""
    scale = float(body.get("scale", 1))
    return {"start": [-scale] * 3, "goal": [scale] * 3, "frame": "object", "clearance": 0}


def _photo(number: int, media_type: str | None) -> tuple[str, bytes]:
    kind = media_type if media_type in ("image/jpeg", "image/webp") else "image/png"
    return kind, image_file(disc(size=(120 + number, 90)), kind.removeprefix("image/").upper())


def _weights(number: int, media_type: str | None) -> tuple[str, bytes]:
    weights = Weights(tiny_model.SPEC, initial_theta(tiny_model.SPEC, number), "m")
    return "application/octet-stream", dump(weights, "safetensors")


def _tensor(number: int, media_type: str | None) -> tuple[str, bytes]:
    shape = [1, 3, tiny_model.SIZE, tiny_model.SIZE]
    image = {"name": "image", "datatype": "FP32", "shape": shape, "data": [number / 100] * (3 * tiny_model.SIZE**2)}
    return "application/json", json.dumps({"inputs": [image]}).encode()


BODIES = {
    "POST /encode": _photo,
    "POST /objects": _weights,
    "POST /v2/models/{name}/infer": _tensor,
    "POST /v2/models/{name}/versions/{version}/infer": _tensor,
}


@schemathesis.deserializer("model/gltf+json")
def gltf(context: schemathesis.DeserializationContext, response: schemathesis.Response) -> object:
    """Read a glTF answer as JSON."""
    return response.json()
