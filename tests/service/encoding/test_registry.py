"""Two models in one service: the model that encodes, and the model that an object records."""

import base64
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest

from service.encoding.encoder import Encoder
from service.encoding.framing import Framing, preprocess
from service.encoding.registry import Models
from service.errors import InvalidModel
from service.mapping.spec import MappingSpec
from service.settings import Settings
from tests.support.server import running
from tests.support.small import model as tiny_model

OTHER = MappingSpec("tiny", input_dim=3, hidden=(16,), output_dim=3, k=4, domain="sphere")


@pytest.fixture
def other_path(tmp_path: Path) -> Path:
    return tiny_model.build(tmp_path / "tiny-k4.onnx", OTHER, meta=tiny_model.metadata(OTHER, "tiny-k4"))


@pytest.fixture
def client(settings: Settings, model_path: Path, other_path: Path) -> Iterator[httpx.Client]:
    with (
        running(settings.model_copy(update={"model": (model_path, other_path)})) as server,
        httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=60) as client,
    ):
        yield client


def test_models_list_has_the_default_first(client: httpx.Client) -> None:
    listed = client.get("/models").json()["models"]
    assert [model["name"] for model in listed] == ["tiny-k2", "tiny-k4"]
    assert client.get("/model").json() == client.get("/model?model=tiny-k2").json() == listed[0]
    assert client.get("/model?model=tiny-k4").json() == listed[1]
    assert (listed[1]["spec"]["k"], listed[1]["spec"]["domain"]) == (4, "sphere")


def test_encode_with_a_model_name_uses_and_records_that_model(client: httpx.Client, photo: bytes) -> None:
    default = client.post("/encode", content=photo).json()
    answer = client.post("/encode?model=tiny-k4&include=weights", content=photo)
    item = answer.json()
    assert answer.status_code == 201
    assert item["id"] != default["id"]
    theta = np.frombuffer(base64.b64decode(item["weights"]), "<f4")
    framed = preprocess(photo, Framing(tiny_model.SIZE, 0.85))
    np.testing.assert_allclose(theta, tiny_model.theta_of(framed.tensor, OTHER)[0], atol=1e-5)
    stored = client.get(item["links"]["self"]).json()
    assert (stored["model"], stored["spec"]["k"], stored["spec"]["domain"]) == ("tiny-k4", 4, "sphere")
    assert client.post("/encode?model=tiny-k4", content=photo).json()["id"] == item["id"]
    assert client.post("/encode?model=tiny-k2", content=photo).json()["id"] == default["id"]
    assert client.get(item["links"]["points"], params={"n": 10}).status_code == 200


def test_encode_without_store_uses_the_named_model(client: httpx.Client, photo: bytes) -> None:
    answer = client.post("/encode?model=tiny-k4&store=false", content=photo).json()
    assert (answer["model"], answer["spec"]["k"]) == ("tiny-k4", 4)


@pytest.mark.parametrize(("method", "path"), [("POST", "/encode"), ("GET", "/model")])
def test_model_name_that_is_not_loaded_is_422_with_the_loaded_names(
    client: httpx.Client, photo: bytes, method: str, path: str
) -> None:
    problem = client.request(method, f"{path}?model=tiny", content=photo).json()
    assert (problem["status"], [error["field"] for error in problem["errors"]]) == (422, ["model"])
    assert "there is tiny-k2, tiny-k4" in problem["detail"]


def test_compose_of_objects_of_two_models_is_422(client: httpx.Client, photo: bytes) -> None:
    ids = [
        client.post("/encode", params={"model": name}, content=photo).json()["id"] for name in ("tiny-k2", "tiny-k4")
    ]
    problem = client.post("/compose", json={"objects": ids}).json()
    assert (problem["status"], problem["errors"][0]["field"]) == (422, "objects[1]")
    assert "specs must be equal" in problem["detail"]


def test_open_of_two_models_of_one_name_raises_invalid_model(model_path: Path, tmp_path: Path) -> None:
    copy = tiny_model.build(tmp_path / "copy.onnx", OTHER)
    with pytest.raises(InvalidModel, match=r"tiny-k2\.onnx and .*copy\.onnx are both named tiny-k2: load one of them"):
        Models.open([model_path, copy], threads=1)


def test_ready_service_has_warmed_up_every_model(
    settings: Settings, model_path: Path, other_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    warm: list[str] = []
    monkeypatch.setattr(Encoder, "warm_up", lambda encoder: warm.append(encoder.name))
    with running(settings.model_copy(update={"model": (model_path, other_path)})):
        assert warm == ["tiny-k2", "tiny-k4"]
