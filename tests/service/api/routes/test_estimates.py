"""Shape confidence and camera in the answers, over a real socket."""

import json
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest

from service.encoding.encoder import Encoder
from service.encoding.framing import preprocess
from service.settings import Settings
from tests.support.server import running
from tests.support.small import model as tiny_model


@pytest.fixture
def estimating_path(tmp_path: Path) -> Path:
    return tiny_model.build(tmp_path / "tiny-k2.onnx", estimates=True)


@pytest.fixture
def estimating(settings: Settings, estimating_path: Path) -> Iterator[httpx.Client]:
    """Open a client of a service whose model makes estimates; it shares the store with that of `client`."""
    changed = settings.model_copy(update={"model": (estimating_path,)})
    with running(changed) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=60) as client:
        yield client


def test_encode_answers_the_estimates_and_keeps_them(
    estimating: httpx.Client, estimating_path: Path, photo: bytes
) -> None:
    encoder = Encoder.open(estimating_path, 1)
    expected = encoder.encode(preprocess(photo, encoder.framing).tensor)[0].estimates
    assert expected
    answer = estimating.post("/encode", content=photo).json()
    assert answer["shape_confidence"] == pytest.approx(expected.shape_confidence, abs=1e-3)
    assert answer["camera"].keys() == {"azimuth", "elevation", "distance", "roll"}
    assert answer["camera"]["azimuth"] == pytest.approx(expected.camera.azimuth, abs=0.1)
    assert estimating.get(answer["links"]["self"]).json() == answer
    assert estimating.get("/objects").json()["items"][0]["camera"] == answer["camera"]
    assert estimating.post("/encode", content=photo).json() == answer
    unkept = estimating.post("/encode?store=false", content=photo).json()
    assert {name: unkept[name] for name in ("shape_confidence", "camera")} == {
        name: answer[name] for name in ("shape_confidence", "camera")
    }


def test_objects_that_no_model_estimated_have_no_estimates(
    estimating: httpx.Client, client: httpx.Client, photo: bytes
) -> None:
    estimated = estimating.post("/encode", content=photo).json()
    other = client.post("/encode", content=photo).json()
    weights = estimating.get(estimated["links"]["weights"]).content
    imported = estimating.post("/objects", content=weights).json()
    composed = estimating.post("/compose", json={"objects": [estimated["id"], imported["id"]]}).json()
    for item in (other, imported, composed):
        assert not {"shape_confidence", "camera"} & item.keys()
    assert client.get(estimated["links"]["self"]).json() == estimated


def test_infer_gives_the_estimates_as_outputs(estimating: httpx.Client) -> None:
    size = tiny_model.SIZE
    image = np.random.default_rng(0).random((2, 3, size, size)).round(3)
    body = {"inputs": [{"name": "image", "shape": image.shape, "datatype": "FP32", "data": image.ravel().tolist()}]}
    answer = estimating.post("/v2/models/tiny-k2/infer", content=json.dumps(body)).json()
    outputs = {output["name"]: output for output in answer["outputs"]}
    assert list(outputs) == ["theta", "shape_confidence", "camera"]
    assert (outputs["shape_confidence"]["shape"], outputs["camera"]["shape"]) == ([2, 1], [2, 4])
    assert outputs["shape_confidence"]["data"] == pytest.approx(image[:, 0].mean(axis=(1, 2)), abs=1e-5)
    assert outputs["camera"]["data"][0] == pytest.approx(90 * image[0, 2].mean(), abs=1e-3)
