"""Calls of both clients, each against a running service."""

from pathlib import Path

import httpx
import numpy as np
import pytest
from PIL import Image

from hof_client import (
    Client,
    CorruptImage,
    CorruptWeights,
    Forbidden,
    InUse,
    InvalidParameter,
    NoObjectFound,
    NotFound,
    Retry,
    StoredObject,
    TooLarge,
    Unauthenticated,
)
from service.api.keys import make_key
from service.formats.weights import load
from service.settings import Settings
from tests.support.photos import disc, image_file
from tests.support.server import Open, Server, running
from tests.support.small.ball import ball_file
from tests.support.small.model import COLOR_SPEC, SIZE, SPEC

PHOTO = image_file(disc())


def test_encode_returns_the_object_with_its_report(hof: Client) -> None:
    stored = hof.encode(PHOTO, include="weights")
    assert (stored.kind, stored.model, stored.spec.hidden) == ("encoded", "tiny-k2", tuple(SPEC.hidden))
    assert stored.image.confidence is None or 0 < stored.image.confidence <= 1
    assert stored.weights is not None
    assert (stored.weights.shape, stored.weights.dtype.name) == ((SPEC.size,), "float32")
    assert stored.color_weights is not None
    assert stored.color_weights.shape == (COLOR_SPEC.size,)
    assert hof.encode(PHOTO) == stored
    assert hof.encode(PHOTO).weights is None


def test_encode_of_a_path_equals_that_of_its_bytes(hof: Client, tmp_path: Path) -> None:
    path = tmp_path / "photo.png"
    path.write_bytes(PHOTO)
    assert hof.encode(path).id == hof.encode(str(path)).id == hof.encode(PHOTO).id


def test_encode_views_returns_one_object_of_several_photos(hof: Client) -> None:
    photos = [PHOTO, image_file(disc("blue", at=(10, 20)))]
    stored = hof.encode_views(photos, label="Disc", include="weights")
    assert (stored.kind, stored.label) == ("encoded", "Disc")
    assert stored.images is not None
    assert stored.images[0] == stored.image
    assert [report.mask for report in stored.images] == ["border", "border"]
    alone = [hof.encode(photo, include="weights").weights for photo in photos]
    assert stored.weights is not None
    assert np.allclose(stored.weights, np.mean([each for each in alone if each is not None], axis=0), atol=1e-6)
    assert hof.encode_views(photos[:1]).id == hof.encode(PHOTO).id
    assert hof.encode(PHOTO).images is None


def test_encode_only_returns_the_weights_and_keeps_nothing(hof: Client, disc_object: StoredObject) -> None:
    count = len(list(hof.iter_objects()))
    encoded = hof.encode_only(image_file(disc()), background="keep", model="tiny-k2")
    assert encoded.image.mask == "none"
    assert encoded.weights.shape == (SPEC.size,)
    assert max(encoded.dimensions) == pytest.approx(1)
    assert len(list(hof.iter_objects())) == count


def test_encode_of_bad_images_raises(hof: Client) -> None:
    with pytest.raises(CorruptImage):
        hof.encode(PHOTO[:200])
    with pytest.raises(NoObjectFound):
        hof.encode(image_file(Image.new("RGB", (64, 64), (90, 120, 150))), background="remove")
    with pytest.raises(InvalidParameter) as caught:
        hof.encode(PHOTO, foreground_ratio=2)
    assert [error.field for error in caught.value.errors] == ["foreground_ratio"]
    assert caught.value.request_id


def test_image_over_the_limit_is_too_large(connect: Open, server: Server) -> None:
    client = connect(f"http://127.0.0.1:{server.port}", retry=Retry(times=0))
    for _ in range(5):
        with pytest.raises(TooLarge, match="limit is 200000"):
            client.encode(bytes(8_000_000))


def test_objects_are_listed_read_and_deleted(hof: Client, disc_object: StoredObject) -> None:
    assert hof.object(disc_object.id).links.self == f"/objects/{disc_object.id}"
    other = hof.encode(image_file(disc()), background="keep")
    page = hof.objects(limit=1)
    assert (page.limit, len(page.items)) == (1, 1)
    assert page.next
    ids = {item.id for item in hof.objects(limit=500, cursor=page.next).items} | {page.items[0].id}
    assert {disc_object.id, other.id} <= ids == {item.id for item in hof.iter_objects()}
    assert hof.delete(other.id) is None
    with pytest.raises(NotFound):
        hof.object(other.id)
    with pytest.raises(NotFound):
        hof.delete(other.id)


def test_iter_objects_goes_through_all_pages(
    hof: Client, disc_object: StoredObject, monkeypatch: pytest.MonkeyPatch
) -> None:
    hof.encode(image_file(disc()), background="keep")
    expected = [item.id for item in hof.objects(limit=500).items]
    monkeypatch.setattr("hof_client.calls.MAX_LIMIT", 1)
    assert len(expected) >= 2
    assert [item.id for item in hof.iter_objects()] == expected


def test_compositions_are_made_of_stored_objects(hof: Client, disc_object: StoredObject) -> None:
    a, b = disc_object.id, hof.encode(image_file(disc()), background="keep").id
    word = hof.compose([a, b])
    assert (word.kind, word.word) == ("composed", (a, b))
    assert hof.theta(word.id).shape == (SPEC.k, SPEC.size)
    mean = hof.interpolate([a, b])
    assert (mean.kind, mean.parents) == ("interpolated", (a, b))
    assert [each.word for each in hof.compose_all([a, b]).objects] == [(a, a), (a, b), (b, a), (b, b)]
    with pytest.raises(InUse):
        hof.delete(a)
    with pytest.raises(InvalidParameter):
        hof.compose([a])


def test_weights_come_back_as_an_object(hof: Client, disc_object: StoredObject) -> None:
    file = hof.weights(disc_object.id)
    theta = hof.theta(disc_object.id)
    assert np.array_equal(theta, load(file).theta)
    assert hof.weights(disc_object.id, format="onnx")
    assert load(hof.weights(disc_object.id, dtype="float16")).dtype == "float16"
    imported = hof.import_object(file)
    assert imported.kind == "imported"
    assert np.array_equal(hof.theta(imported.id), theta)
    with pytest.raises(CorruptWeights):
        hof.import_object(file[:-1])


def test_mesh_returns_the_file_of_the_format(hof: Client, disc_object: StoredObject) -> None:
    assert hof.mesh(disc_object.id, resolution=8)[:4] == b"glTF"
    assert hof.mesh(disc_object.id, format="ply", resolution=8, scale=2, color="none").startswith(b"ply\n")


def test_picture_returns_the_file_of_the_format(hof: Client, disc_object: StoredObject) -> None:
    assert hof.picture(disc_object.id, size=32).startswith(b"\x89PNG")
    assert hof.picture(disc_object.id, format="webp", size=32, view="front", color="none")[8:12] == b"WEBP"


def test_label_and_photo_are_kept_with_the_object(hof: Client) -> None:
    stored = hof.encode(image_file(disc("green")), label="Ünïcode disc", keep_photo=True)
    assert stored.label == "Ünïcode disc"
    assert hof.photo(stored.id)[8:12] == b"WEBP"
    assert hof.set_label(stored.id, "Other").label == "Other"
    assert hof.set_label(stored.id, None).label is None
    assert hof.encode(image_file(disc("green"))).id == stored.id
    with pytest.raises(InvalidParameter):
        hof.set_label(stored.id, "x" * 81)
    with pytest.raises(NotFound):
        hof.photo("0" * 32)
    hof.delete(stored.id)


def test_path_is_planned_as_waypoints_and_as_a_file(hof: Client) -> None:
    ball = hof.import_object(ball_file())
    around = hof.path(ball.id, (-1.8, 0.1, 0.1), np.array([1.8, 0.1, 0.1]), scale=2, clearance=0.1, cells=24)
    assert around.path is not None
    assert (around.path[0], around.path[-1]) == ((-1.8, 0.1, 0.1), (1.8, 0.1, 0.1))
    assert around.length is not None
    assert (around.length > 3.6, around.straight, around.reason) == (True, False, None)
    assert hof.path_file(ball.id, (-1, 0, 0), (1, 0, 0))[:4] == b"glTF"
    enclosed = hof.path(ball.id, (-1, 0, 0), (0, 0, 0))
    assert (enclosed.path, enclosed.length, enclosed.reason) == (None, None, "enclosed")
    with pytest.raises(InvalidParameter, match="enclosed"):
        hof.path_file(ball.id, (-1, 0, 0), (0, 0, 0))


def test_models_and_probes_and_metrics_answer(hof: Client) -> None:
    assert (hof.live().status, hof.ready().status) == ("live", "ready")
    first = hof.models().models[0]
    assert hof.model() == hof.model("tiny-k2") == first
    assert first.framing
    assert (first.name, first.framing.size) == ("tiny-k2", SIZE)
    assert "# TYPE hof_" in hof.metrics()


def test_inference_protocol_describes_the_model(hof: Client) -> None:
    assert hof.inference_server().name == "hof"
    assert hof.inference_live().live
    assert hof.inference_ready().ready
    for version in (None, "1"):
        model = hof.inference_model("tiny-k2", version=version)
        assert [tensor.name for tensor in model.outputs] == ["theta", "color"]
        assert hof.inference_config("tiny-k2", version=version).input[0].dims == (3, SIZE, SIZE)
        assert hof.inference_model_ready("tiny-k2", version=version).ready
    with pytest.raises(NotFound):
        hof.inference_model("other")
    with pytest.raises(NotFound):
        hof.inference_model_ready("tiny-k2", version="2")


def test_infer_returns_each_image_as_weights(hof: Client) -> None:
    images = np.random.default_rng(0).random((3, 3, SIZE, SIZE), np.float32)
    outputs = hof.infer("tiny-k2", images)
    assert {name: array.shape for name, array in outputs.items()} == {
        "theta": (3, SPEC.size),
        "color": (3, COLOR_SPEC.size),
    }
    alone = hof.infer("tiny-k2", images[1:2], version="1")
    assert np.allclose(alone["theta"][0], outputs["theta"][1], atol=1e-5)
    with pytest.raises(InvalidParameter):
        hof.infer("tiny-k2", images[:, :1])


def test_api_key_is_sent(connect: Open, model_path: Path, tmp_path: Path) -> None:
    token, key = make_key("reader", frozenset({"read"}))
    (tmp_path / "keys").write_text(f"{key.line}\n")
    store = f"sqlite:///{tmp_path / 'hof.db'}"
    with running(
        Settings(model=(model_path,), database_url=store, threads=1, api_keys_file=tmp_path / "keys")
    ) as server:
        url = f"http://127.0.0.1:{server.port}"
        assert connect(url, api_key=token).objects().items == ()
        with pytest.raises(Unauthenticated, match="needs an API key"):
            connect(url).objects()
        with pytest.raises(Forbidden, match="scope write"):
            connect(url, api_key=token).encode(PHOTO)


def test_base_url_with_a_prefix_leads_to_the_service() -> None:
    urls: list[str] = []

    def answer(request: httpx.Request) -> httpx.Response:
        urls.append(str(request.url))
        return httpx.Response(200, json={"status": "live"})

    with Client("https://example.com/hof/", transport=httpx.MockTransport(answer)) as client:
        client.live()
    with Client("https://example.com/hof", transport=httpx.MockTransport(answer)) as client:
        client.live()
    assert urls == ["https://example.com/hof/health/live"] * 2
