"""The Open Inference Protocol, spoken by Triton's own client."""

import base64
import json
import math
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from tritonclient.http import InferenceServerClient, InferInput, InferRequestedOutput, InferResult
from tritonclient.utils import InferenceServerException

from service.encoding.framing import Framing, preprocess
from service.mapping.spec import Array
from service.runtime.batcher import MAX_BATCH
from service.settings import Settings
from tests.support.server import Server, running
from tests.support.slow import DEADLINE_S, runtime_of, until
from tests.support.small import model as tiny_model

MODEL = "/v2/models/tiny-k2"
ONE = [1, 3, tiny_model.SIZE, tiny_model.SIZE]


@pytest.fixture(scope="module")
def server(model_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """Run one server for all tests: an inference leaves nothing behind."""
    store = tmp_path_factory.mktemp("inference") / "hof.db"
    with running(Settings(model=(model_path,), database_url=f"sqlite:///{store}", threads=2)) as server:
        yield server


@pytest.fixture
def triton(server: Server) -> Iterator[InferenceServerClient]:
    with InferenceServerClient(f"127.0.0.1:{server.port}") as client:
        yield client


@pytest.fixture
def images(photo: bytes) -> Array:
    """(2, 3, size, size): a framed photo, and another image."""
    framed = preprocess(photo, Framing(tiny_model.SIZE, 0.85)).tensor
    return np.concatenate([framed, framed[:, ::-1] / 2])


def _infer(triton: InferenceServerClient, images: Array, *, binary: bool = True, **options: object) -> InferResult:
    tensor = InferInput("image", list(images.shape), "FP32")
    tensor.set_data_from_numpy(images, binary_data=binary)
    return triton.infer("tiny-k2", [tensor], **options)


def _request(**changes: object) -> dict[str, Any]:
    """Return a request of one white image, with changes to its input."""
    return {"inputs": [{"name": "image", "shape": ONE, "datatype": "FP32", "data": [1] * math.prod(ONE)} | changes]}


def test_infer_triton_client_finds_server_and_model(triton: InferenceServerClient) -> None:
    assert triton.is_server_live()
    assert triton.is_server_ready()
    assert triton.is_model_ready("tiny-k2")
    assert not triton.is_model_ready("other")
    assert triton.get_server_metadata()["extensions"] == ["binary_tensor_data"]
    assert triton.get_model_metadata("tiny-k2") == {
        "name": "tiny-k2",
        "versions": ["1"],
        "platform": "onnxruntime_onnx",
        "inputs": [{"name": "image", "datatype": "FP32", "shape": [-1, *ONE[1:]]}],
        "outputs": [{"name": "theta", "datatype": "FP32", "shape": [-1, tiny_model.SPEC.size]}],
    }


def test_infer_triton_client_finds_configuration_and_version(triton: InferenceServerClient, images: Array) -> None:
    config = triton.get_model_config("tiny-k2")
    assert (config["name"], config["max_batch_size"]) == ("tiny-k2", MAX_BATCH)
    assert config["input"] == [{"name": "image", "data_type": "TYPE_FP32", "dims": ONE[1:]}]
    assert config["output"] == [{"name": "theta", "data_type": "TYPE_FP32", "dims": [tiny_model.SPEC.size]}]
    assert triton.get_model_config("tiny-k2", "1") == config
    assert triton.get_model_metadata("tiny-k2", "1") == triton.get_model_metadata("tiny-k2")
    assert triton.is_model_ready("tiny-k2", "1")
    assert not triton.is_model_ready("tiny-k2", "2")
    thetas = [_infer(triton, images, model_version=version).as_numpy("theta") for version in ("", "1")]
    np.testing.assert_array_equal(*thetas)
    with pytest.raises(InferenceServerException, match="no such version"):
        triton.get_model_config("tiny-k2", "2")


@pytest.mark.parametrize("binary", [True, False])
@pytest.mark.parametrize("binary_out", [True, False])
def test_infer_theta_equals_that_of_encode(
    triton: InferenceServerClient,
    client: httpx.Client,
    images: Array,
    photo: bytes,
    binary: bool,
    binary_out: bool,
) -> None:
    outputs = [InferRequestedOutput("theta", binary_data=binary_out)]
    result = _infer(triton, images, binary=binary, outputs=outputs, request_id="seven")
    assert result.get_response()["id"] == "seven"
    assert ("data" in result.get_output("theta")) != binary_out
    theta = result.as_numpy("theta")
    assert theta.dtype == np.float32
    np.testing.assert_allclose(theta, tiny_model.theta_of(images), atol=1e-5)
    encoded = client.post("/encode?store=false", content=photo).json()["weights"]
    np.testing.assert_allclose(theta[0], np.frombuffer(base64.b64decode(encoded), "<f4"), atol=1e-5)
    assert client.get("/objects").json()["items"] == []


def test_infer_with_a_colored_model_returns_the_requested_outputs(
    settings: Settings, colored_path: Path, images: Array
) -> None:
    matrix, b = tiny_model.color_parameters()
    color = images.mean(axis=(2, 3)) @ matrix + b
    with (
        running(settings.model_copy(update={"model": (colored_path,)})) as server,
        InferenceServerClient(f"127.0.0.1:{server.port}") as triton,
    ):
        both = _infer(triton, images)
        np.testing.assert_allclose(both.as_numpy("theta"), tiny_model.theta_of(images), atol=1e-5)
        np.testing.assert_allclose(both.as_numpy("color"), color, atol=1e-5)
        one = _infer(triton, images, outputs=[InferRequestedOutput("color")])
        assert [output["name"] for output in one.get_response()["outputs"]] == ["color"]
        np.testing.assert_allclose(one.as_numpy("color"), color, atol=1e-5)
        assert [each["name"] for each in triton.get_model_metadata("tiny-k2")["outputs"]] == ["theta", "color"]


def test_infer_with_nested_numbers_answers_json(client: httpx.Client, images: Array) -> None:
    answer = client.post(f"{MODEL}/infer", json=_request(data=images[:1].tolist()))
    assert (answer.status_code, answer.headers["content-type"]) == (200, "application/json")
    (theta,) = answer.json()["outputs"]
    assert theta["shape"] == [1, tiny_model.SPEC.size]
    np.testing.assert_allclose(theta["data"], tiny_model.theta_of(images[:1])[0], atol=1e-5)


def test_infer_errors_are_readable_by_triton(triton: InferenceServerClient) -> None:
    with pytest.raises(InferenceServerException, match=rf"b from 1 to {MAX_BATCH}") as caught:
        _infer(triton, np.ones((MAX_BATCH + 1, *ONE[1:]), np.float32))
    assert caught.value.status() == "422"
    with pytest.raises(InferenceServerException, match="there is tiny-k2") as caught:
        triton.get_model_metadata("other")
    assert caught.value.status() == "404"


def test_infer_with_a_full_batch_of_long_numbers_fits(client: httpx.Client) -> None:
    shape = [MAX_BATCH, *ONE[1:]]
    numbers = np.random.default_rng(0).uniform(1e-5, 1e-4, math.prod(shape)).tolist()
    assert client.post(f"{MODEL}/infer", json=_request(shape=shape, data=numbers)).status_code == 200


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"name": "picture"}, "inputs[0].name"),
        ({"datatype": "FP64"}, "inputs[0].datatype"),
        ({"shape": [1, 3, 8, 8]}, "inputs[0].shape"),
        ({"shape": [0, *ONE[1:]], "data": []}, "inputs[0].shape"),
        ({"shape": []}, "inputs[0].shape"),
        ({"shape": ["1", *ONE[1:]]}, "inputs[0].shape[0]"),
        ({"data": [1] * 7}, "inputs[0].data"),
        ({"data": [[1, 1], [1]]}, "inputs[0].data"),
        ({"data": ["1"] * math.prod(ONE)}, "inputs[0].data"),
        ({"data": [True] * math.prod(ONE)}, "inputs[0].data"),
        ({"data": [10**30] * math.prod(ONE)}, "inputs[0].data"),
        ({"data": [1.5] * math.prod(ONE)}, "inputs[0].data"),
        ({"data": [-0.1] * math.prod(ONE)}, "inputs[0].data"),
        ({"data": None}, "inputs[0].data"),
        ({"parameters": {"binary_data_size": 4}}, "inputs[0].data"),
        ({"parameters": {"shared_memory_region": "x"}}, "inputs[0].parameters.shared_memory_region"),
    ],
)
def test_infer_with_a_faulty_input_names_it(client: httpx.Client, changes: dict[str, Any], field: str) -> None:
    answer = client.post(f"{MODEL}/infer", json=_request(**changes))
    assert (answer.status_code, answer.headers["content-type"]) == (422, "application/problem+json")
    assert answer.json()["errors"][0]["field"] == field
    assert answer.json()["error"] == answer.json()["detail"]


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"inputs": []}, "inputs"),
        ({"inputs": _request()["inputs"] * 2}, "inputs"),
        ({"outputs": [{"name": "color"}]}, "outputs[0].name"),
        ({"outputs": [{"name": "theta"}] * 5}, "outputs"),
        ({"output": []}, "output"),
    ],
)
def test_infer_with_a_faulty_request_names_the_member(
    client: httpx.Client, changes: dict[str, Any], field: str
) -> None:
    answer = client.post(f"{MODEL}/infer", json=_request() | changes)
    assert (answer.status_code, answer.json()["errors"][0]["field"]) == (422, field)


def _binary(tensor: bytes, size: int) -> tuple[bytes, bytes]:
    """Return the JSON of a request and its tensor."""
    image = {"name": "image", "shape": ONE, "datatype": "FP32", "parameters": {"binary_data_size": size}}
    return json.dumps({"inputs": [image]}).encode(), tensor


@pytest.mark.parametrize(
    ("tensor", "size"),
    [
        (b"", 4 * math.prod(ONE)),
        (bytes(4 * math.prod(ONE)), 4),
        (bytes(4 * math.prod(ONE) + 1), 4 * math.prod(ONE)),
        (np.full(ONE, np.nan, "<f4").tobytes(), 4 * math.prod(ONE)),
        (np.full(ONE, np.inf, "<f4").tobytes(), 4 * math.prod(ONE)),
    ],
)
def test_infer_with_faulty_bytes_is_refused(client: httpx.Client, tensor: bytes, size: int) -> None:
    header, tensor = _binary(tensor, size)
    headers = {"Inference-Header-Content-Length": str(len(header))}
    answer = client.post(f"{MODEL}/infer", content=header + tensor, headers=headers)
    assert (answer.status_code, answer.json()["type"]) == (422, "urn:hof:problem:invalid-parameter")


@pytest.mark.parametrize(
    ("body", "headers", "status"),
    [
        (b"{", {}, 400),
        (b"\xff", {}, 400),
        (b"[" * 10_000, {}, 400),
        (b"[]", {}, 422),
        (b'{"inputs": NaN}', {}, 400),
        (b"{}", {"Inference-Header-Content-Length": "3"}, 400),
        (b"{}", {"Inference-Header-Content-Length": "-1"}, 400),
        (b"{}", {"Content-Encoding": "gzip"}, 415),
        (bytes(MAX_BATCH * 3 * tiny_model.SIZE**2 * 24 + 16_385), {}, 413),
    ],
)
def test_infer_with_a_body_that_is_no_request_is_refused(
    client: httpx.Client, body: bytes, headers: dict[str, str], status: int
) -> None:
    answer = client.post(f"{MODEL}/infer", content=body, headers=headers)
    assert (answer.status_code, answer.json()["status"]) == (status, status)


@pytest.mark.parametrize("call", ["GET /v2/models/other", "GET /v2/models/other/ready", "POST /v2/models/other/infer"])
def test_infer_with_an_unknown_model_answers_404(client: httpx.Client, call: str) -> None:
    answer = client.request(*call.split(), json=_request() if call.startswith("POST") else None)
    assert (answer.status_code, answer.json()["error"]) == (404, "no loaded model is named 'other'; there is tiny-k2")


def test_infer_with_a_batch_counts_each_image_in_the_gate(settings: Settings, slow_model: Path) -> None:
    blue = np.zeros((2, *ONE[1:]))  # the darkest channel is black: half a second
    blue[:, 2] = 1
    two = _request(shape=[2, *ONE[1:]], data=blue.ravel().tolist())
    with (
        running(settings.model_copy(update={"model": (slow_model,), "max_queued_images": 2})) as server,
        httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=DEADLINE_S) as client,
        ThreadPoolExecutor(1) as pool,
    ):
        gate = runtime_of(server).gates.images
        taken = pool.submit(client.post, f"{MODEL}/infer", json=two)
        until(lambda: gate.held == 2)
        refused = client.post(f"{MODEL}/infer", json=_request())
        assert (refused.status_code, refused.json()["type"]) == (429, "urn:hof:problem:overloaded")
        assert int(refused.headers["retry-after"]) >= 1
        assert taken.result().status_code == 200
        assert (gate.held, gate.finished, gate.refused, gate.failed) == (0, 1, 1, 0)
