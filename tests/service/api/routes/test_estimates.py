"""Shape confidence and camera in the answers, over a real socket."""

import io
import json
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest
import skimage.data
from PIL import Image

from service.cli import main
from service.encoding.decode import decode
from service.encoding.encoder import Encoder
from service.encoding.framing import preprocess
from service.encoding.matting import Matting
from service.formats.weights import load
from service.mapping.spec import Array
from service.runtime.bulk.photos import Setup, encode_photos
from service.settings import SHIPPED_MATTING, Settings
from tests.support import ROOT
from tests.support.photos import image_file
from tests.support.server import check_refused, running
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


@pytest.mark.system
def test_encode_of_a_large_object_before_a_background_merges_two_looks_everywhere(
    settings: Settings, estimating_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photo, other = _chair_on_grass(90), _chair_on_grass(80)
    encoder, matting = Encoder.open(estimating_path, 1), Matting.of(SHIPPED_MATTING, 1)
    framed = preprocess(photo, encoder.framing, matting=matting)
    expected = encoder.encode_photo(framed)
    mean = (expected.theta + encoder.encode_photo(preprocess(other, encoder.framing, matting=matting)).theta) / 2
    assert expected.estimates
    assert (framed.mask, len(framed.looks)) == ("matting", 2)
    assert np.abs(expected.theta - encoder.encode(framed.tensor)[0].theta).max() > 1e-3
    changed = settings.model_copy(update={"model": (estimating_path,), "matting_model": SHIPPED_MATTING})
    with running(changed) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=60) as client:
        answer = client.post("/encode", content=photo).json()
        weights = client.get(answer["links"]["weights"]).content
        twice = client.post("/encode", files=[("image", photo), ("image", other)]).json()
        of_both = client.get(twice["links"]["weights"]).content
    assert answer["shape_confidence"] == pytest.approx(expected.estimates.shape_confidence, abs=1e-3)
    (tmp_path / "chair.png").write_bytes(photo)
    models = ["--model", str(estimating_path), "--matting-model", str(SHIPPED_MATTING)]
    setup = Setup(estimating_path, SHIPPED_MATTING, "auto", None, 200_000, 1_000_000)
    (item,) = encode_photos(setup, [str(tmp_path / "chair.png")])
    assert item.entry
    assert item.entry.record.id == answer["id"]
    assert item.entry.functions
    np.testing.assert_allclose(item.entry.functions.theta, expected.theta, atol=1e-5)
    assert main(["encode", str(tmp_path / "chair.png"), "-o", str(tmp_path / "chair.safetensors"), *models]) == 0
    for file, theta in ((weights, expected.theta), (of_both, mean), (tmp_path / "chair.safetensors", expected.theta)):
        data = file if isinstance(file, bytes) else file.read_bytes()
        np.testing.assert_allclose(load(data).theta, theta, atol=1e-5)


def _chair_on_grass(quality: int) -> bytes:
    chair = decode((ROOT / "demo" / "chair.png").read_bytes()).convert("RGBA").resize((240, 240))
    picture = Image.fromarray(skimage.data.grass()).convert("RGB").crop((0, 0, 300, 330))
    picture.paste(chair, (30, 20), chair)
    return image_file(picture, "JPEG", quality=quality)


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


def _points(client: httpx.Client, path: str, query: str) -> Array:
    answer = client.get(f"{path}?format=npy&n=3000&sampling=sobol{query}")
    assert answer.status_code == 200
    array: Array = np.load(io.BytesIO(answer.content))
    return array


def test_points_in_the_camera_frame_lie_in_the_box_of_the_photo(estimating: httpx.Client, photo: bytes) -> None:
    item = estimating.post("/encode", content=photo).json()
    image = item["image"]
    viewed = _points(estimating, item["links"]["points"], "&frame=camera&fx=500&scale=0.4")
    assert (viewed[:, 2] > 0).all()
    pixels = viewed[:, :2] / viewed[:, 2:] * 500 + (image["width"] / 2, image["height"] / 2)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    left, top, right, bottom = image["box"]
    assert (low + high) / 2 == pytest.approx([(left + right) / 2, (top + bottom) / 2], abs=1)
    assert max(high - low) == pytest.approx(max(right - left, bottom - top), rel=0.02)


def test_points_in_the_camera_frame_are_those_of_the_object_frame_moved(estimating: httpx.Client, photo: bytes) -> None:
    item = estimating.post("/encode", content=photo).json()
    plain = _points(estimating, item["links"]["points"], "")
    viewed = _points(estimating, item["links"]["points"], "&frame=camera")
    assert np.linalg.norm(viewed.mean(axis=0)) == pytest.approx(item["camera"]["distance"], rel=0.2)
    steps, moved = (np.linalg.norm(np.diff(points, axis=0), axis=1) for points in (plain, viewed))
    np.testing.assert_allclose(moved, steps, atol=1e-5)
    turned = _points(estimating, item["links"]["points"], "&frame=camera&azimuth=120")
    assert np.abs(turned - viewed).max() > 0.1


def test_files_in_the_camera_frame_tell_its_axes(estimating: httpx.Client, photo: bytes) -> None:
    links = estimating.post("/encode", content=photo).json()["links"]
    for path, query in ((links["points"], "n=10&format=ply"), (links["mesh"], "format=ply&resolution=8")):
        plain, viewed = (estimating.get(f"{path}?{query}&frame={frame}") for frame in ("object", "camera"))
        assert b"+Y is up" in plain.content
        assert b"+Y is down, +Z is forward" in viewed.content
        assert int(viewed.headers["content-length"]) == len(viewed.content)
        tag = viewed.headers["etag"]
        assert tag != plain.headers["etag"]
        assert estimating.get(f"{path}?{query}&frame=camera&roll=10").headers["etag"] != tag
        assert estimating.get(f"{path}?{query}&frame=camera", headers={"If-None-Match": tag}).status_code == 304


@pytest.mark.parametrize(
    ("query", "field", "message"),
    [
        ("frame=camera", "azimuth", "give azimuth, elevation, distance"),
        ("frame=camera&azimuth=10&elevation=10", "distance", "give azimuth, elevation, distance"),
        ("azimuth=10", "azimuth", "needs frame=camera"),
        ("frame=camera&azimuth=10&elevation=10&distance=3&cx=10", "cx", "needs fx"),
        ("frame=camera&azimuth=10&elevation=91&distance=3", "elevation", "90"),
        ("frame=camera&azimuth=10&elevation=10&distance=0.5", "distance", "0.9"),
        ("frame=camera&azimuth=nan&elevation=10&distance=3", "azimuth", "360"),
        ("frame=camera&azimuth=10&elevation=10&fx=0", "fx", "greater than 0"),
    ],
)
def test_camera_frame_without_a_whole_camera_is_refused(
    client: httpx.Client, photo: bytes, query: str, field: str, message: str
) -> None:
    links = client.post("/encode", content=photo).json()["links"]
    check_refused(client.get(f"{links['points']}?{query}"), field, message)
    check_refused(client.get(f"{links['mesh']}?{query}"), field, message)


def test_camera_frame_of_an_object_without_a_photo_looks_at_its_center(client: httpx.Client, photo: bytes) -> None:
    links = client.post("/encode", content=photo).json()["links"]
    imported = client.post("/objects", content=client.get(links["weights"]).content).json()["links"]
    camera = "&frame=camera&azimuth=10&elevation=10&distance=3"
    viewed = _points(client, imported["points"], camera)
    assert viewed.mean(axis=0) == pytest.approx([0, 0, 3], abs=0.3)
    check_refused(client.get(f"{imported['points']}?{camera[1:]}&fx=500"), "fx", "needs a photo")
