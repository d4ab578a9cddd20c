"""GET /objects/{id}/weights over a real socket."""

import io
import json

import httpx
import numpy as np
import onnxruntime as ort
import pytest
from safetensors.numpy import load as load_safetensors

from service.formats.weights import Weights, dump, load
from service.mapping.canonical import canonical_points
from service.mapping.spec import initial_theta
from tests.support.server import check_refused
from tests.support.small.objects import SPEC, compose, encode_discs, weights_file


def test_weights_in_every_format_hold_theta(client: httpx.Client) -> None:
    link = client.post("/objects", content=weights_file()).json()["links"]["weights"]
    files = {name: client.get(link, params={"format": name}) for name in ("safetensors", "npy", "json")}
    theta = initial_theta(SPEC)
    np.testing.assert_array_equal(load_safetensors(files["safetensors"].content)["theta"], theta)
    np.testing.assert_array_equal(np.load(io.BytesIO(files["npy"].content)), theta)
    np.testing.assert_array_equal(np.float32(json.loads(files["json"].content)["theta"]), theta)
    for name, answer in files.items():
        assert answer.headers["content-disposition"].endswith(f'.{name}"')
    assert files["json"].headers["content-type"] == "application/json"


@pytest.mark.parametrize("query", ["format=pt", "format=", "n=5"])
def test_weights_with_bad_parameters_are_refused(client: httpx.Client, query: str) -> None:
    (object_id,) = encode_discs(client, "red")
    answer = client.get(f"/objects/{object_id}/weights?{query}")
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == query.split("=")[0]


@pytest.mark.parametrize("dtype", ["float16", "int8"])
def test_weights_in_fewer_bytes_tell_their_loss_and_come_back(client: httpx.Client, dtype: str) -> None:
    links = client.post("/objects", content=weights_file()).json()["links"]
    plain, small = (client.get(links["weights"], params={"dtype": each}) for each in ("float32", dtype))
    assert len(small.content) < len(plain.content)
    assert small.headers["etag"] != plain.headers["etag"]
    assert plain.content == client.get(links["weights"]).content
    weights = load(small.content)
    assert weights.dtype == dtype
    assert weights.loss is not None
    imported = client.post("/objects", content=small.content).json()["links"]
    points, moved = (
        np.load(io.BytesIO(client.get(each["points"], params={"n": 2048, "format": "npy", "frame": "raw"}).content))
        for each in (links, imported)
    )
    assert weights.frame is not None
    distances = np.linalg.norm(moved.astype(np.float64) - points, axis=1) / weights.frame.unit
    assert distances.mean() == pytest.approx(weights.loss.mean, rel=0.01, abs=1e-6)
    assert distances.max() == pytest.approx(weights.loss.largest, rel=0.01, abs=1e-6)


@pytest.mark.parametrize("name", ["npy", "json", "onnx"])
def test_weights_in_fewer_bytes_need_safetensors(client: httpx.Client, name: str) -> None:
    (object_id,) = encode_discs(client, "red")
    path = f"/objects/{object_id}/weights"
    check_refused(client.get(path, params={"format": name, "dtype": "int8"}), "dtype", "use format=safetensors")
    check_refused(client.get(path, params={"dtype": "int4"}), "dtype", "'float32', 'float16' or 'int8'")


def test_weights_beyond_float16_are_refused_as_float16(client: httpx.Client) -> None:
    file = dump(Weights(SPEC, np.float32(1e6) * initial_theta(SPEC), "m"), "safetensors")
    path = client.post("/objects", content=file).json()["links"]["weights"]
    check_refused(client.get(path, params={"dtype": "float16"}), "dtype", "65504")
    assert client.get(path, params={"dtype": "int8"}).status_code == 200


def test_weights_of_a_composed_object_hold_thetas_and_word(client: httpx.Client) -> None:
    a, b = encode_discs(client, "red", "green")
    link = compose(client, b, a)["links"]["weights"]
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


def test_weights_as_onnx_are_the_whole_function(client: httpx.Client) -> None:
    a, b = encode_discs(client, "red", "green")
    for object_id in (a, compose(client, a, b)["id"]):
        answer = client.get(f"/objects/{object_id}/weights", params={"format": "onnx"})
        assert answer.headers["content-type"] == "application/x-onnx"
        assert answer.headers["content-disposition"].endswith('.onnx"')
        (points,) = ort.InferenceSession(answer.content).run(None, {"x": canonical_points("ball", 300, 0)})
        served = client.get(f"/objects/{object_id}/points", params={"n": 300, "format": "npy"})
        np.testing.assert_allclose(points, np.load(io.BytesIO(served.content)), atol=1e-5)
