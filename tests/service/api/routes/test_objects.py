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
    made: dict[str, Any] = client.post("/compose", json={"objects": ids, "mode": mode}).json()
    return made


def test_an_object_tells_what_it_is(client: httpx.Client) -> None:
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


def test_the_list_is_newest_first_in_pages(client: httpx.Client) -> None:
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
def test_a_bad_page_is_refused(client: httpx.Client, query: str) -> None:
    answer = client.get(f"/objects?{query}")
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == query.split("=")[0]


def test_delete_removes_an_object_once(client: httpx.Client) -> None:
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
def test_unknown_ids_are_not_found(client: httpx.Client, object_id: str, path: str) -> None:
    answer = client.get(f"/objects/{object_id}{path}")
    assert (answer.status_code, answer.json()["title"]) == (404, "Not found")


def test_objects_survive_a_restart(settings: Settings, photo: bytes) -> None:
    clouds = []
    for _ in range(2):
        with running(settings) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}") as client:
            made = client.post("/encode", content=photo)
            clouds.append(client.get(made.json()["links"]["points"]).content)
    assert made.status_code == 200
    assert clouds[0] == clouds[1]


def test_weights_go_out_and_come_in_again(client: httpx.Client) -> None:
    (object_id,) = _encode(client, "red")
    answer = client.get(f"/objects/{object_id}/weights")
    assert answer.headers["content-disposition"] == f'attachment; filename="hof-{object_id}.safetensors"'
    posted = client.post("/objects", content=answer.content)
    made = posted.json()
    assert (posted.status_code, posted.headers["location"]) == (201, f"/objects/{made['id']}")
    assert (made["kind"], made["model"]) == ("imported", "tiny-k2")
    assert made["id"] != object_id
    points = [client.get(f"/objects/{each}/points?n=100").content for each in (object_id, made["id"])]
    assert points[0] == points[1]
    again = client.post("/objects", content=answer.content)
    assert (again.status_code, again.json()) == (200, made)


def test_an_import_keeps_its_own_spec_and_model(client: httpx.Client) -> None:
    made = client.post("/objects", content=_weights()).json()
    assert (made["model"], made["spec"]["k"], made["spec"]["domain"]) == ("elsewhere", 3, "cube")
    weights = load(client.get(made["links"]["weights"]).content)
    assert (weights.spec, weights.model) == (SPEC, "elsewhere")
    np.testing.assert_array_equal(weights.theta, initial_theta(SPEC))
    other = client.post("/objects", content=_weights(1)).json()
    assert other["id"] != made["id"]


def test_every_weights_format_holds_theta(client: httpx.Client) -> None:
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
def test_bad_weights_are_refused_and_nothing_is_stored(client: httpx.Client, body: bytes, status: int) -> None:
    answer = client.post("/objects", content=body)
    assert (answer.status_code, answer.json()["status"]) == (status, status)
    assert client.get("/objects").json()["items"] == []


@pytest.mark.parametrize("query", ["format=pt", "format=", "n=5"])
def test_bad_parameters_of_weights_are_refused(client: httpx.Client, query: str) -> None:
    (object_id,) = _encode(client, "red")
    answer = client.get(f"/objects/{object_id}/weights?{query}")
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == query.split("=")[0]


# Composed objects: what they give, and what they hold back


def test_weights_of_a_composed_object_hold_its_thetas_and_its_word(client: httpx.Client) -> None:
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


def test_the_file_of_a_composed_object_is_no_object(client: httpx.Client) -> None:
    made = _compose(client, *_encode(client, "red", "green"))
    answer = client.post("/objects", content=client.get(made["links"]["weights"]).content)
    assert answer.status_code == 422
    assert "composed" in answer.json()["detail"]
    assert {item["kind"] for item in client.get("/objects").json()["items"]} == {"encoded", "composed"}


def test_onnx_is_the_whole_function(client: httpx.Client) -> None:
    a, b = _encode(client, "red", "green")
    for object_id in (a, _compose(client, a, b)["id"]):
        answer = client.get(f"/objects/{object_id}/weights", params={"format": "onnx"})
        assert answer.headers["content-type"] == "application/x-onnx"
        assert answer.headers["content-disposition"].endswith('.onnx"')
        (points,) = ort.InferenceSession(answer.content).run(None, {"x": canonical_points("ball", 300, 0)})
        served = client.get(f"/objects/{object_id}/points", params={"n": 300, "format": "npy"})
        np.testing.assert_allclose(points, np.load(io.BytesIO(served.content)), atol=1e-5)


def test_an_object_that_a_word_uses_is_not_deleted(client: httpx.Client) -> None:
    a, b, c = _encode(client, "red", "green", "blue")
    made = [_compose(client, a, b)["id"], _compose(client, b, b)["id"]]
    assert client.delete(f"/objects/{c}").status_code == 204
    refused = [client.delete(f"/objects/{each}") for each in (b, a)]
    assert [(answer.status_code, answer.json()["title"]) for answer in refused] == [(409, "In use")] * 2
    details = [answer.json()["detail"] for answer in refused]
    assert details[0] == f"composed objects are made of it: {made[0]}, {made[1]}; delete them first"
    assert made[1] not in details[1]
    for object_id in (*made, a, b):
        assert client.delete(f"/objects/{object_id}").status_code == 204
    assert client.get("/objects").json()["items"] == []


def test_an_interpolated_object_outlives_its_parents(client: httpx.Client) -> None:
    a, b = _encode(client, "red", "green")
    mean = _compose(client, a, b, mode="interpolate")
    before = client.get(mean["links"]["points"]).content
    assert [client.delete(f"/objects/{each}").status_code for each in (a, b)] == [204, 204]
    assert client.get(mean["links"]["self"]).json() == mean
    assert client.get(mean["links"]["points"]).content == before
