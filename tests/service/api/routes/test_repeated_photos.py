"""Repeated photos are answered from the store, without decoding."""

from unittest.mock import Mock

import httpx
import pytest

from service.encoding.framing import preprocess
from service.runtime.inputs import views
from service.runtime.inputs.photos import PhotoKey, RecentPhoto, RecentPhotos
from service.settings import Settings
from tests.support.photos import disc, image_file
from tests.support.server import running


@pytest.fixture
def decoding(monkeypatch: pytest.MonkeyPatch) -> Mock:
    """Return a mock that counts the photos that are decoded."""
    decoding = Mock(wraps=preprocess)
    monkeypatch.setattr(views, "preprocess", decoding)
    return decoding


def test_repeated_photo_is_answered_without_decoding(client: httpx.Client, photo: bytes, decoding: Mock) -> None:
    first = client.post("/encode?include=weights", content=photo)
    again = client.post("/encode?include=weights", files={"image": photo})
    short = client.post("/encode", content=photo)
    assert (first.status_code, again.status_code, short.status_code) == (201, 200, 200)
    assert again.json() == first.json()
    assert short.json() == {name: value for name, value in first.json().items() if name != "weights"}
    assert "location" not in again.headers
    assert decoding.call_count == 1


@pytest.mark.parametrize("options", ["background=keep", "foreground_ratio=0.5", "store=false"])
def test_repeated_photo_with_other_options_is_decoded(
    client: httpx.Client, photo: bytes, decoding: Mock, options: str
) -> None:
    first = client.post("/encode", content=photo).json()
    other = client.post(f"/encode?{options}", content=photo).json()
    assert other.get("id") != first["id"]
    assert decoding.call_count == 2


def test_other_photo_is_decoded(client: httpx.Client, photo: bytes, decoding: Mock) -> None:
    client.post("/encode", content=photo)
    assert client.post("/encode", content=image_file(disc("blue"))).status_code == 201
    assert decoding.call_count == 2


def test_repeated_views_are_answered_without_decoding(client: httpx.Client, photo: bytes, decoding: Mock) -> None:
    views = [("image", photo), ("image", image_file(disc("blue")))]
    first, again = client.post("/encode", files=views), client.post("/encode", files=views)
    assert (first.status_code, again.status_code) == (201, 200)
    assert again.json() == first.json()
    assert len(again.json()["images"]) == 2
    assert decoding.call_count == 2
    assert client.post("/encode", files=views[::-1]).status_code == 201
    assert decoding.call_count == 4


def test_photo_of_a_deleted_object_is_encoded_again(client: httpx.Client, photo: bytes, decoding: Mock) -> None:
    first = client.post("/encode", content=photo).json()
    assert client.delete(first["links"]["self"]).status_code == 204
    assert client.post("/encode", content=photo).status_code == 201
    assert client.post("/encode", content=photo).status_code == 200
    assert decoding.call_count == 2


def test_repeat_adds_a_label_without_decoding_and_a_photo_with_it(
    client: httpx.Client, photo: bytes, decoding: Mock
) -> None:
    client.post("/encode", content=photo)
    labeled = client.post("/encode", files={"image": photo}, data={"label": "stool"}).json()
    assert labeled["label"] == "stool"
    assert client.post("/encode", files={"image": photo}, data={"label": "chair"}).json()["label"] == "stool"
    assert decoding.call_count == 1
    kept = client.post("/encode?keep_photo=true", content=photo).json()
    assert client.get(kept["links"]["photo"]).status_code == 200
    assert decoding.call_count == 2
    assert client.post("/encode?keep_photo=true", content=photo).json() == kept
    assert decoding.call_count == 2


def test_photo_that_was_refused_is_refused_again(client: httpx.Client, decoding: Mock) -> None:
    white = image_file(disc("white"))
    answers = [client.post("/encode", content=white) for _ in range(2)]
    assert [answer.status_code for answer in answers] == [422, 422]
    assert decoding.call_count == 2


def test_photo_that_another_process_encoded_is_decoded_once(
    settings: Settings, client: httpx.Client, photo: bytes, decoding: Mock
) -> None:
    with (
        running(settings) as other,
        httpx.Client(base_url=f"http://127.0.0.1:{other.port}", timeout=60) as there,
    ):
        client.post("/encode", content=photo)
        assert [there.post("/encode", content=photo).status_code for _ in range(2)] == [200, 200]
    assert decoding.call_count == 2


def test_recent_photos_drop_the_one_that_was_longest_unused() -> None:
    recent = RecentPhotos(size=2)
    keys: list[PhotoKey] = [(name, "model", "auto", 0.85) for name in (b"a", b"b", b"c")]
    a, b, c = keys
    one, two, three, four = (RecentPhoto(name, ()) for name in "1234")
    recent.keep(a, one)
    recent.keep(b, two)
    assert recent.find(a) == one
    recent.keep(c, three)
    assert [recent.find(key) for key in (a, b, c)] == [one, None, three]
    assert len(recent) == 2
    recent.keep(a, four)
    assert recent.find(a) == four
    assert len(recent) == 2
