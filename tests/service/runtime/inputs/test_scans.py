"""POST /encode with points of a part of an object, over a socket."""

import base64
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from hof_client import Client
from service.encoding.clouds import LEAST_POINTS, rotation
from service.encoding.completion import complete
from service.encoding.encoder import Encoder
from service.mapping.spec import Array
from service.settings import Settings
from tests.support.server import check_refused, running
from tests.support.small import model as tiny_model
from tests.support.small.data import box

CLOUD = 3 * box(1)[:1_000] + np.array([1, 2, 3], np.float32)


def npy(points: Array) -> bytes:
    file = io.BytesIO()
    np.save(file, points)
    return file.getvalue()


def _numbers(answer: dict[str, Any]) -> Array:
    return np.frombuffer(base64.b64decode(answer["weights"]), "<f4")


@pytest.fixture(scope="session")
def points_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tiny_model.build_points(tmp_path_factory.mktemp("model") / "points.onnx")


@pytest.fixture
def service(settings: Settings, model_path: Path, points_model: Path) -> Iterator[httpx.Client]:
    """Open a client of a service with an encoder of images and one of points."""
    both = settings.model_copy(update={"model": (model_path, points_model)})
    with running(both) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=60) as client:
        yield client


def test_encode_of_points_completes_them_in_their_frame(service: httpx.Client, points_model: Path) -> None:
    answer = service.post("/encode?include=weights", content=npy(CLOUD))
    item = answer.json()
    assert answer.status_code == 201
    assert answer.headers["location"] == item["links"]["self"]
    assert (item["kind"], item["model"], item["placement"]["count"]) == ("encoded", "tiny-k2-points", 1_000)
    encoder = Encoder.open(points_model, 1)
    sent, functions = complete(encoder, CLOUD)
    np.testing.assert_allclose(_numbers(item), functions.theta, atol=1e-6)
    path = item["links"]["points"]
    raw, own = (
        np.load(io.BytesIO(service.get(f"{path}?n=200&format=npy&frame={frame}").content))
        for frame in ("raw", "object")
    )
    placement = item["placement"]
    assert placement["turn"] == sent.turn
    placed = placement["scale"] * own @ rotation(sent.turn).T + placement["center"]
    np.testing.assert_allclose(placed, sent.place(raw), atol=1e-4)
    assert "image" not in service.get(item["links"]["self"]).json()


def test_encode_of_points_rounds_as_the_setting_of_the_store_says(
    settings: Settings, points_model: Path, tmp_path: Path
) -> None:
    halves = {"model": (points_model,), "store_dtype": "float16", "database_url": f"sqlite:///{tmp_path / 'half.db'}"}
    with (
        running(settings.model_copy(update=halves)) as server,
        httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=60) as client,
    ):
        theta = _numbers(client.post("/encode?include=weights", content=npy(CLOUD)).raise_for_status().json())
    np.testing.assert_array_equal(theta, theta.astype(np.float16))
    assert (theta != complete(Encoder.open(points_model, 1), CLOUD)[1].theta).any()


def test_encode_of_moved_and_scaled_points_gives_the_same_function(service: httpx.Client) -> None:
    first = service.post("/encode?include=weights", content=npy(CLOUD)).json()
    other = service.post("/encode?include=weights", content=npy(4 * CLOUD - 7)).json()
    assert other["id"] != first["id"]
    np.testing.assert_allclose(_numbers(other), _numbers(first), atol=1e-5)
    assert other["placement"]["scale"] == pytest.approx(4 * first["placement"]["scale"], rel=1e-5)
    np.testing.assert_allclose(other["placement"]["center"], 4 * np.array(first["placement"]["center"]) - 7, atol=1e-4)


def test_encode_of_points_again_returns_the_same_object(service: httpx.Client) -> None:
    first = service.post("/encode", files={"points": ("a.npy", npy(CLOUD))}, data={"label": "scan"})
    again = service.post("/encode", content=npy(CLOUD))
    assert (first.status_code, again.status_code) == (201, 200)
    assert again.json() == first.json()
    assert first.json()["label"] == "scan"
    kept = service.post("/encode?store=false", content=npy(CLOUD))
    assert kept.status_code == 200
    assert kept.json()["placement"] == first.json()["placement"]
    assert len(service.get("/objects").json()["items"]) == 1


def test_encode_of_a_photo_beside_points_takes_the_model_of_images(service: httpx.Client, photo: bytes) -> None:
    assert service.post("/encode", content=photo).json()["model"] == "tiny-k2"
    assert service.post("/encode", content=npy(CLOUD)).json()["model"] == "tiny-k2-points"
    models = service.get("/models").json()["models"]
    assert [("framing" in each, each.get("points")) for each in models] == [(True, None), (False, tiny_model.COUNT)]
    check_refused(service.post("/encode?model=tiny-k2-points", content=photo), "model", "takes points or a mesh")
    check_refused(service.post("/encode?model=tiny-k2", content=npy(CLOUD)), "model", "takes an image")
    assert service.get("/v2/models/tiny-k2-points").status_code == 404


def test_encode_of_points_without_a_model_for_them_names_the_setting(client: httpx.Client) -> None:
    answer = client.post("/encode", content=npy(CLOUD))
    assert answer.status_code == 415
    assert "no model for points or meshes is loaded: name one with --model or HOF_MODEL" in answer.json()["detail"]


def test_encode_of_a_photo_without_a_model_for_it_names_the_setting(
    settings: Settings, points_model: Path, photo: bytes
) -> None:
    alone = settings.model_copy(update={"model": (points_model,)})
    with running(alone) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=60) as client:
        assert client.get("/health/ready").status_code == 200
        assert client.post("/encode", content=npy(CLOUD)).status_code == 201
        answer = client.post("/encode", content=photo)
        assert answer.status_code == 415
        assert "no model for images is loaded" in answer.json()["detail"]


@pytest.mark.parametrize(
    ("content", "status", "message"),
    [
        (npy(CLOUD[: LEAST_POINTS - 1]), 422, "there are 63 points, at least 64 are needed"),
        (npy(np.ones((100, 3), np.float32)), 422, "all points are at the same place"),
        (npy(CLOUD)[:-4], 400, "its header says otherwise"),
        (npy(np.full((100, 3), np.inf)), 400, "no finite float32"),
        (npy(np.zeros((16_700, 3), np.float32)), 413, "the limit is 200000"),
    ],
    ids=["few", "one place", "cut", "infinite", "large"],
)
def test_encode_of_faulty_points_is_refused(service: httpx.Client, content: bytes, status: int, message: str) -> None:
    for answer in (service.post("/encode", content=content), service.post("/encode", files={"points": content})):
        assert answer.status_code == status
        assert message in answer.json()["detail"]
    assert service.get("/objects").json()["items"] == []


def test_encode_of_points_and_images_together_is_refused(service: httpx.Client, photo: bytes) -> None:
    check_refused(service.post("/encode", files={"points": npy(CLOUD), "image": photo}), "points", "send one of them")
    answer = service.post("/encode", files={"points": photo})
    assert answer.status_code == 415
    assert "PLY, PCD, NPY or XYZ points, or a GLB, OBJ or STL mesh" in answer.json()["detail"]


@pytest.mark.parametrize("query", ["background=keep", "foreground_ratio=0.5", "keep_photo=true"])
def test_encode_of_points_with_an_option_of_images_is_refused(service: httpx.Client, query: str) -> None:
    check_refused(service.post(f"/encode?{query}", content=npy(CLOUD)), query.split("=")[0], "is for images")


def test_client_encodes_points(service: httpx.Client) -> None:
    with Client(str(service.base_url)) as hof:
        stored = hof.encode_points(npy(CLOUD), label="scan", include="weights")
        assert (stored.label, stored.placement.count) == ("scan", 1_000)
        kept = hof.encode_points_only(npy(CLOUD), model="tiny-k2-points")
        assert stored.weights is not None
        np.testing.assert_array_equal(kept.weights, stored.weights)
        assert kept.placement == stored.placement
