"""The stored objects over a real socket: list, get, delete, import, weights."""

import io
import json
from datetime import UTC, datetime, timedelta
from typing import Any

import httpx
import numpy as np
import onnxruntime as ort
import pytest
from safetensors.numpy import load as load_safetensors

from service.formats.weights import Weights, dump, load
from service.mapping.canonical import canonical_points
from service.mapping.spec import MappingSpec, initial_theta
from service.settings import Settings
from tests.support.photos import disc, image_file
from tests.support.server import running

SPEC = MappingSpec("small", 3, (8, 8), 3, activation="tanh", k=3, domain="cube")


def _weights(seed: int = 0) -> bytes:
    return dump(Weights(SPEC, initial_theta(SPEC, seed), "elsewhere"), "safetensors")


def _encode(client: httpx.Client, *colours: str) -> list[str]:
    return [client.post("/encode", content=image_file(disc(colour))).json()["id"] for colour in colours]


def _compose(client: httpx.Client, *ids: str, mode: str = "compose") -> dict[str, Any]:
    item: dict[str, Any] = client.post("/compose", json={"objects": ids, "mode": mode}).json()
    return item


def test_object_read_returns_all_its_fields(client: httpx.Client) -> None:
    (object_id,) = _encode(client, "red")
    answer = client.get(f"/objects/{object_id}").json()
    created = datetime.fromisoformat(answer.pop("created_at"))
    assert abs(datetime.now(UTC) - created) < timedelta(minutes=1)
    assert answer == {
        "id": object_id,
        "kind": "encoded",
        "model": "tiny-k2",
        "spec": {
            "name": "tiny",
            "input_dim": 3,
            "hidden": [16],
            "output_dim": 3,
            "activation": "relu",
            "k": 2,
            "domain": "ball",
        },
        "bytes": 460,
        "links": {
            "self": f"/objects/{object_id}",
            "points": f"/objects/{object_id}/points",
            "mesh": f"/objects/{object_id}/mesh",
            "weights": f"/objects/{object_id}/weights",
        },
    }
    for link in answer["links"].values():
        assert client.get(link).status_code == 200


def test_objects_list_is_newest_first_in_pages(client: httpx.Client) -> None:
    ids = _encode(client, "red", "green", "blue")
    first = client.get("/objects?limit=2").json()
    assert ([item["id"] for item in first["items"]], first["limit"]) == ([ids[2], ids[1]], 2)
    newer = _encode(client, "black")
    second = client.get("/objects", params={"limit": 2, "cursor": first["next"]}).json()
    assert ([item["id"] for item in second["items"]], second["next"]) == ([ids[0]], None)
    everything = client.get("/objects").json()
    assert [item["id"] for item in everything["items"]] == newer + ids[::-1]
    assert (everything["limit"], everything["next"]) == (50, None)


@pytest.mark.parametrize("query", ["limit=0", "limit=501", "limit=x", "cursor=x", "cursor=", "page=2"])
def test_objects_list_with_a_bad_page_is_refused(client: httpx.Client, query: str) -> None:
    answer = client.get(f"/objects?{query}")
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == query.split("=")[0]


def test_delete_of_an_object_removes_it_once(client: httpx.Client) -> None:
    red, green = _encode(client, "red", "green")
    answer = client.delete(f"/objects/{red}")
    assert (answer.status_code, answer.content) == (204, b"")
    for path in ("", "/points", "/weights"):
        assert client.get(f"/objects/{red}{path}").status_code == 404
    assert client.delete(f"/objects/{red}").status_code == 404
    assert [item["id"] for item in client.get("/objects").json()["items"]] == [green]
    assert _encode(client, "red") == [red]  # it can be made again


@pytest.mark.parametrize("object_id", ["0" * 32, "x", "0" * 31, "A" * 32, "%00", "0" * 32 + "%0A", "é", "a" * 5000])
@pytest.mark.parametrize("path", ["", "/points", "/weights"])
def test_object_with_an_unknown_id_answers_404(client: httpx.Client, object_id: str, path: str) -> None:
    answer = client.get(f"/objects/{object_id}{path}")
    assert (answer.status_code, answer.json()["title"]) == (404, "Not found")


def test_objects_after_a_restart_are_kept(settings: Settings, photo: bytes) -> None:
    clouds = []
    for _ in range(2):
        with running(settings) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}") as client:
            answer = client.post("/encode", content=photo)
            clouds.append(client.get(answer.json()["links"]["points"]).content)
    assert answer.status_code == 200
    assert clouds[0] == clouds[1]


def test_import_of_exported_weights_gives_an_object(client: httpx.Client) -> None:
    (object_id,) = _encode(client, "red")
    answer = client.get(f"/objects/{object_id}/weights")
    assert answer.headers["content-disposition"] == f'attachment; filename="hof-{object_id}.safetensors"'
    posted = client.post("/objects", content=answer.content)
    item = posted.json()
    assert (posted.status_code, posted.headers["location"]) == (201, f"/objects/{item['id']}")
    assert (item["kind"], item["model"]) == ("imported", "tiny-k2")
    assert item["id"] != object_id
    points = [client.get(f"/objects/{each}/points?n=100").content for each in (object_id, item["id"])]
    assert points[0] == points[1]
    again = client.post("/objects", content=answer.content)
    assert (again.status_code, again.json()) == (200, item)


def test_import_keeps_the_spec_and_model_of_the_file(client: httpx.Client) -> None:
    item = client.post("/objects", content=_weights()).json()
    assert (item["model"], item["spec"]["k"], item["spec"]["domain"]) == ("elsewhere", 3, "cube")
    weights = load(client.get(item["links"]["weights"]).content)
    assert (weights.spec, weights.model) == (SPEC, "elsewhere")
    np.testing.assert_array_equal(weights.theta, initial_theta(SPEC))
    other = client.post("/objects", content=_weights(1)).json()
    assert other["id"] != item["id"]


def test_weights_in_every_format_hold_theta(client: httpx.Client) -> None:
    link = client.post("/objects", content=_weights()).json()["links"]["weights"]
    files = {name: client.get(link, params={"format": name}) for name in ("safetensors", "npy", "json")}
    theta = initial_theta(SPEC)
    np.testing.assert_array_equal(load_safetensors(files["safetensors"].content)["theta"], theta)
    np.testing.assert_array_equal(np.load(io.BytesIO(files["npy"].content)), theta)
    np.testing.assert_array_equal(np.float32(json.loads(files["json"].content)["theta"]), theta)
    for name, answer in files.items():
        assert answer.headers["content-disposition"].endswith(f'.{name}"')
    assert files["json"].headers["content-type"] == "application/json"


RELU = MappingSpec("relu", 3, (8,), 3, k=4)


@pytest.mark.parametrize(
    ("body", "status"),
    [
        (b"", 400),
        (b"nonsense", 400),
        (_weights()[:-1], 400),
        (_weights() + b"x", 400),
        (bytes(100_001), 413),
        (_weights().replace(b'\\"k\\":3', b'\\"k\\":0'), 422),
        (_weights().replace(b"cube", b"conn"), 422),
        (dump(Weights(RELU, np.full(RELU.size, 1e30, np.float32), "overflows"), "safetensors"), 400),
    ],
)
def test_import_of_bad_weights_is_refused_and_stores_nothing(client: httpx.Client, body: bytes, status: int) -> None:
    answer = client.post("/objects", content=body)
    assert (answer.status_code, answer.json()["status"]) == (status, status)
    assert client.get("/objects").json()["items"] == []


@pytest.mark.parametrize("query", ["format=pt", "format=", "n=5"])
def test_weights_with_bad_parameters_are_refused(client: httpx.Client, query: str) -> None:
    (object_id,) = _encode(client, "red")
    answer = client.get(f"/objects/{object_id}/weights?{query}")
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == query.split("=")[0]


# Composed objects: what they give, and what they hold back


def test_weights_of_a_composed_object_hold_thetas_and_word(client: httpx.Client) -> None:
    a, b = _encode(client, "red", "green")
    link = _compose(client, b, a)["links"]["weights"]
    files = {name: client.get(link, params={"format": name}).content for name in ("safetensors", "npy", "json")}
    thetas = [load(client.get(f"/objects/{each}/weights").content).theta for each in (b, a)]
    weights = load(files["safetensors"])
    assert weights.word == (b, a)
    np.testing.assert_array_equal(weights.theta, thetas)
    np.testing.assert_array_equal(load_safetensors(files["safetensors"])["theta"], thetas)
    np.testing.assert_array_equal(np.load(io.BytesIO(files["npy"])), thetas)
    as_json = json.loads(files["json"])
    assert (as_json["word"], as_json["format"]) == ([b, a], "hof-word-1")
    np.testing.assert_array_equal(np.float32(as_json["theta"]), thetas)


def test_import_of_a_composed_file_is_refused(client: httpx.Client) -> None:
    item = _compose(client, *_encode(client, "red", "green"))
    answer = client.post("/objects", content=client.get(item["links"]["weights"]).content)
    assert answer.status_code == 422
    assert "composed" in answer.json()["detail"]
    assert {item["kind"] for item in client.get("/objects").json()["items"]} == {"encoded", "composed"}


def test_weights_as_onnx_are_the_whole_function(client: httpx.Client) -> None:
    a, b = _encode(client, "red", "green")
    for object_id in (a, _compose(client, a, b)["id"]):
        answer = client.get(f"/objects/{object_id}/weights", params={"format": "onnx"})
        assert answer.headers["content-type"] == "application/x-onnx"
        assert answer.headers["content-disposition"].endswith('.onnx"')
        (points,) = ort.InferenceSession(answer.content).run(None, {"x": canonical_points("ball", 300, 0)})
        served = client.get(f"/objects/{object_id}/points", params={"n": 300, "format": "npy"})
        np.testing.assert_allclose(points, np.load(io.BytesIO(served.content)), atol=1e-5)


def test_delete_of_an_object_in_a_word_answers_409(client: httpx.Client) -> None:
    a, b, c = _encode(client, "red", "green", "blue")
    words = [_compose(client, a, b)["id"], _compose(client, b, b)["id"]]
    assert client.delete(f"/objects/{c}").status_code == 204
    refused = [client.delete(f"/objects/{each}") for each in (b, a)]
    assert [(answer.status_code, answer.json()["title"]) for answer in refused] == [(409, "In use")] * 2
    details = [answer.json()["detail"] for answer in refused]
    assert details[0] == f"composed objects are made of it: {words[0]}, {words[1]}; delete them first"
    assert words[1] not in details[1]
    for object_id in (*words, a, b):
        assert client.delete(f"/objects/{object_id}").status_code == 204
    assert client.get("/objects").json()["items"] == []


def test_interpolated_object_after_deleting_parents_is_kept(client: httpx.Client) -> None:
    a, b = _encode(client, "red", "green")
    mean = _compose(client, a, b, mode="interpolate")
    before = client.get(mean["links"]["points"]).content
    assert [client.delete(f"/objects/{each}").status_code for each in (a, b)] == [204, 204]
    assert client.get(mean["links"]["self"]).json() == mean
    assert client.get(mean["links"]["points"]).content == before
