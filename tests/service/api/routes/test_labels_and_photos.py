"""Labels of objects and pictures of their photos, over a real socket."""

import io
import json

import httpx
import numpy as np
import pytest
from PIL import Image

from service.encoding.pixels import MAX_THUMBNAIL_BYTES, THUMBNAIL_SIDE
from tests.support.photos import image_file
from tests.support.server import check_refused

LABEL = "Jürgen's chair 🪑"


def test_encode_with_a_label_keeps_it_and_a_repeat_does_not_change_it(client: httpx.Client, photo: bytes) -> None:
    first = client.post("/encode", files={"image": photo}, data={"label": f"  {LABEL} "})
    assert (first.status_code, first.json()["label"]) == (201, LABEL)
    again = client.post("/encode", files={"image": photo}, data={"label": "other"})
    assert (again.status_code, again.json()["label"]) == (200, LABEL)
    assert client.get("/objects").json()["items"][0]["label"] == LABEL


def test_encode_of_a_repeated_photo_adds_what_its_object_lacks(client: httpx.Client, photo: bytes) -> None:
    plain = client.post("/encode", content=photo).json()
    assert "label" not in plain
    again = client.post("/encode?keep_photo=true", files={"image": photo}, data={"label": LABEL}).json()
    assert (again["id"], again["label"], again["links"]["photo"]) == (
        plain["id"],
        LABEL,
        f"/objects/{plain['id']}/photo",
    )
    assert client.get(again["links"]["photo"]).status_code == 200


@pytest.mark.parametrize(
    "fields",
    [{"label": "x" * 81}, {"label": "two\nlines"}, {"label": "\x00"}, {"label": b"\xff"}, {"label": ["a", "b"]}],
    ids=["long", "lines", "null", "bytes", "twice"],
)
def test_encode_with_a_faulty_label_is_422(client: httpx.Client, photo: bytes, fields: dict[str, str]) -> None:
    answer = client.post("/encode", files={"image": photo}, data=fields)
    check_refused(answer, "label", "label")


def test_label_is_changed_and_removed_and_files_stay_as_they_are(client: httpx.Client, photo: bytes) -> None:
    stored = client.post("/encode", content=photo).json()
    tag = client.head(stored["links"]["weights"]).headers["etag"]
    path = stored["links"]["self"]
    changed = client.patch(path, json={"label": f" {LABEL} "})
    assert (changed.status_code, changed.json()) == (200, stored | {"label": LABEL})
    assert client.get(path).json() == changed.json()
    assert "etag" not in client.get(path).headers  # an old label would be shown
    assert client.head(stored["links"]["weights"]).headers["etag"] == tag
    for nothing in (None, " "):
        assert client.patch(path, json={"label": nothing}).json() == stored


@pytest.mark.parametrize("content", ["{}", '{"label": 1}', '{"label": "a", "id": "b"}', '{"label": "\\u0007"}', "[]"])
def test_label_of_another_form_is_422(client: httpx.Client, photo: bytes, content: str) -> None:
    path = client.post("/encode", content=photo).json()["links"]["self"]
    assert client.patch(path, content=content).status_code == 422
    assert "label" not in client.get(path).json()


def test_label_of_too_many_characters_is_422_and_of_too_many_bytes_413(client: httpx.Client, photo: bytes) -> None:
    path = client.post("/encode", content=photo).json()["links"]["self"]
    assert client.patch(path, json={"label": "🪑" * 80}).status_code == 200
    check_refused(client.patch(path, json={"label": "x" * 81}), "label", "the limit is 80")
    assert client.patch(path, content=json.dumps({"label": "x" * 5000})).status_code == 413
    assert client.patch(path, content="{").status_code == 400


def test_label_of_an_unknown_object_is_404(client: httpx.Client) -> None:
    assert client.patch(f"/objects/{'0' * 32}", json={"label": "x"}).status_code == 404


def test_photo_is_the_object_over_white_and_deleted_with_it(client: httpx.Client, photo: bytes) -> None:
    stored = client.post("/encode?keep_photo=true", content=photo).json()
    answer = client.get(stored["links"]["photo"])
    assert (answer.status_code, answer.headers["content-type"]) == (200, "image/webp")
    assert client.get(stored["links"]["photo"], headers={"If-None-Match": answer.headers["etag"]}).status_code == 304
    picture = np.asarray(Image.open(io.BytesIO(answer.content)).convert("RGB"))
    assert picture.shape == (THUMBNAIL_SIDE, THUMBNAIL_SIDE, 3)
    assert (picture[0] > 250).all()
    assert (picture[THUMBNAIL_SIDE // 2, THUMBNAIL_SIDE // 2] < 200).any()
    assert client.delete(stored["links"]["self"]).status_code == 204
    assert client.get(stored["links"]["photo"]).status_code == 404


def test_photo_that_was_not_to_be_kept_is_404(client: httpx.Client, photo: bytes) -> None:
    stored = client.post("/encode", content=photo).json()
    assert "photo" not in stored["links"]
    answer = client.get(f"{stored['links']['self']}/photo")
    assert answer.status_code == 404
    assert "keep_photo" in answer.json()["detail"]
    assert client.post("/encode?keep_photo=true&store=false", content=photo).status_code == 200


def test_photo_of_noise_keeps_to_the_limit_of_bytes(client: httpx.Client) -> None:
    noise = np.random.default_rng(0).integers(0, 256, (256, 256, 3), np.uint8)
    content = image_file(Image.fromarray(noise))
    stored = client.post("/encode?keep_photo=true&background=keep", content=content).json()
    assert len(client.get(stored["links"]["photo"]).content) <= MAX_THUMBNAIL_BYTES
