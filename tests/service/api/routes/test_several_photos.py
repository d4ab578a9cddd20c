"""POST /encode with several images of one object."""

import base64
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest

from service.mapping.spec import Array
from service.runtime.inputs.views import MAX_IMAGES
from service.settings import Settings
from tests.support.photos import disc, image_file
from tests.support.server import check_refused, running
from tests.support.slow import PATH, plain, runtime_of, until

VIEWS = [image_file(disc("red")), image_file(disc("blue", at=(10, 20))), image_file(disc("green", size=(100, 140)))]


def _post(client: httpx.Client, images: list[bytes], query: str = "", label: str | None = None) -> httpx.Response:
    files = [("image", (f"{index}.png", image)) for index, image in enumerate(images)]
    return client.post(f"/encode{query}", files=files, data={"label": label} if label else {})


def _numbers(answer: dict[str, Any], name: str = "weights") -> Array:
    return np.frombuffer(base64.b64decode(answer[name]), "<f4")


def test_encode_of_several_images_averages_their_functions(colored: httpx.Client) -> None:
    alone = [colored.post("/encode?include=weights", content=view).json() for view in VIEWS]
    answer = _post(colored, VIEWS, "?include=weights")
    item = answer.json()
    assert answer.status_code == 201
    assert answer.headers["location"] == item["links"]["self"]
    for name in ("weights", "color_weights"):
        mean = np.mean([_numbers(each, name) for each in alone], axis=0, dtype=np.float64)
        np.testing.assert_allclose(_numbers(item, name), mean, atol=1e-6)
    assert item["kind"] == "encoded"
    assert item["images"] == [each["image"] for each in alone]
    assert item["image"] == alone[0]["image"]
    stored = colored.get(item["links"]["self"]).json()
    assert (stored["id"], stored["image"]) == (item["id"], item["image"])
    assert "images" not in stored
    assert colored.get(f"{item['links']['points']}?n=10").status_code == 200


def test_encode_of_several_images_again_returns_the_same_object(client: httpx.Client) -> None:
    first, again = _post(client, VIEWS, label="Disc"), _post(client, VIEWS)
    assert (first.status_code, again.status_code) == (201, 200)
    assert first.json() == again.json()
    assert again.json()["label"] == "Disc"
    other_order = _post(client, VIEWS[::-1]).json()
    assert other_order["id"] != first.json()["id"]
    alone = client.post("/encode", content=VIEWS[0]).json()
    assert alone["id"] != first.json()["id"]
    assert _post(client, VIEWS[:1]).json() == alone
    assert "images" not in alone


def test_encode_of_several_images_without_store_returns_the_weights(client: httpx.Client) -> None:
    kept = _post(client, VIEWS, "?include=weights").json()
    answer = _post(client, VIEWS, "?store=false")
    assert answer.status_code == 200
    assert answer.json()["images"] == kept["images"]
    np.testing.assert_array_equal(_numbers(answer.json()), _numbers(kept))
    assert len(client.get("/objects").json()["items"]) == 1


def test_encode_of_several_images_names_the_image_at_fault(client: httpx.Client) -> None:
    blank = image_file(disc("white"))
    for images, status in ([VIEWS[0], VIEWS[1][:200]], 400), ([VIEWS[0], blank], 422), ([VIEWS[0], b"GIF89a"], 415):
        answer = _post(client, images)
        assert answer.status_code == status
        assert answer.json()["detail"].startswith("image 2 of 2: ")
        assert answer.json()["errors"][0]["field"] == "image"
    assert client.get("/objects").json()["items"] == []


def test_encode_of_more_images_than_the_limit_is_refused(client: httpx.Client) -> None:
    images = [image_file(disc("red", at=(10 + index, 20))) for index in range(MAX_IMAGES + 1)]
    assert _post(client, images[:MAX_IMAGES]).status_code == 201
    check_refused(_post(client, images), "image", f"the field image more than {MAX_IMAGES} times")


def test_encode_of_the_same_image_twice_is_refused(client: httpx.Client) -> None:
    check_refused(_post(client, [VIEWS[0], VIEWS[1], VIEWS[0]]), "image", "image 3 of 3 is the same file as image 1")


def test_encode_of_several_images_keeps_the_picture_of_the_first(client: httpx.Client) -> None:
    alone = client.post("/encode?keep_photo=true", content=VIEWS[0]).json()
    item = _post(client, VIEWS[:2], "?keep_photo=true").json()
    assert client.get(item["links"]["photo"]).content == client.get(alone["links"]["photo"]).content


def test_encode_of_images_that_are_too_large_together_is_refused(client: httpx.Client) -> None:
    answer = _post(client, [bytes(100_001), b"x" * 100_001])
    assert answer.status_code == 413
    assert "the images together have 200002 bytes, the limit is 200000" in answer.json()["detail"]


def test_encode_of_several_images_counts_each_of_them(settings: Settings, slow_model: Path) -> None:
    limits = settings.model_copy(update={"model": (slow_model,), "max_queued_images": 3})
    with running(limits) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=60) as client:
        gate = runtime_of(server).gates.images
        with gate.admit():  # another photo is on its way
            refused = _post(client, [plain(255, 255), plain(255, 254), plain(255, 253)], PATH.removeprefix("/encode"))
            assert (refused.status_code, refused.json()["title"]) == (429, "Overloaded")
            assert _post(client, [plain(255, 255), plain(255, 254)], PATH.removeprefix("/encode")).status_code == 201
        until(lambda: gate.held == 0)


@pytest.mark.parametrize("query", ["?background=keep", "?foreground_ratio=0.5"])
def test_encode_of_several_images_frames_each_as_asked(client: httpx.Client, query: str) -> None:
    alone = [client.post(f"/encode{query}", content=view).json()["image"] for view in VIEWS]
    item = _post(client, VIEWS, query).json()
    assert item["images"] == alone
    assert item["id"] != _post(client, VIEWS).json()["id"]
