"""POST /encode over a real socket."""

import base64
import contextlib
import socket
import struct
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import httpx
import numpy as np
import pytest
from PIL import Image

from service.encoding.encoder import Encoder
from service.encoding.framing import Framing, preprocess
from service.settings import Settings
from tests.support.photos import disc, image_file
from tests.support.server import Server
from tests.support.small import model as tiny_model


def _theta(answer: dict[str, Any]) -> np.ndarray[Any, np.dtype[np.float32]]:
    return np.frombuffer(base64.b64decode(answer["weights"]), "<f4")


def _ids(client: httpx.Client) -> list[str]:
    return [item["id"] for item in client.get("/objects").json()["items"]]


def test_encode_of_a_photo_returns_a_new_object(client: httpx.Client, photo: bytes) -> None:
    answer = client.post("/encode", content=photo)
    item = answer.json()
    assert answer.status_code == 201
    assert answer.headers["location"] == item["links"]["self"] == f"/objects/{item['id']}"
    assert len(item["id"]) == 32
    assert (item["kind"], item["model"], item["bytes"]) == ("encoded", "tiny-k2", 4 * tiny_model.SPEC.size)
    assert item["image"] == {"mask": "border", "box": [40, 30, 81, 71], "confidence": 1, "width": 120, "height": 90}
    assert item["links"].keys() == {"self", "points", "mesh", "weights"}
    assert "weights" not in item
    kept = client.get(answer.headers["location"]).json()
    assert kept == item


def test_encode_of_a_repeated_photo_answers_200_without_inference(
    client: httpx.Client, photo: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    first = client.post("/encode?include=weights", content=photo)
    monkeypatch.setattr(Encoder, "encode", None)  # would fail
    for again in (
        client.post("/encode?include=weights", content=photo),
        client.post("/encode?include=weights", files={"image": photo}),
        client.post("/encode?include=weights&background=remove&foreground_ratio=0.85&model=tiny-k2", content=photo),
    ):
        assert (again.status_code, again.json()) == (200, first.json())
        assert "location" not in again.headers
    assert len(_ids(client)) == 1


def test_encode_of_concurrent_equal_photos_makes_one_object(client: httpx.Client, photo: bytes) -> None:
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda _: client.post("/encode", content=photo), range(16)))
    assert sorted(answer.status_code for answer in answers) == [200] * 15 + [201]
    assert len({answer.json()["id"] for answer in answers}) == 1


def test_encode_with_include_weights_returns_the_weights_of_the_network(client: httpx.Client, photo: bytes) -> None:
    theta = _theta(client.post("/encode?include=weights", content=photo).json())
    framed = preprocess(photo, Framing(tiny_model.SIZE, 0.85))
    np.testing.assert_allclose(theta, tiny_model.theta_of(framed.tensor)[0], atol=1e-5)


def test_encode_with_store_false_returns_weights_and_keeps_nothing(client: httpx.Client, photo: bytes) -> None:
    answer = client.post("/encode?store=false", content=photo)
    assert answer.status_code == 200
    assert answer.json().keys() == {"model", "spec", "bytes", "dimensions", "frame", "image", "weights"}
    assert _ids(client) == []
    kept = client.post("/encode?include=weights", content=photo).json()
    assert kept["weights"] == answer.json()["weights"]


@pytest.mark.parametrize("query", ["background=keep", "foreground_ratio=0.5", "foreground_ratio=0.1"])
def test_encode_with_other_options_makes_another_object(client: httpx.Client, photo: bytes, query: str) -> None:
    plain = client.post("/encode?include=weights", content=photo).json()
    other = client.post(f"/encode?include=weights&{query}", content=photo)
    assert other.status_code == 201
    assert other.json()["id"] != plain["id"]
    assert np.abs(_theta(other.json()) - _theta(plain)).max() > 1e-3


@pytest.mark.parametrize("content_type", ["image/jpeg", "application/octet-stream", "text/plain", "nonsense", ""])
def test_encode_of_a_raw_body_detects_its_type_by_content(
    client: httpx.Client, photo: bytes, content_type: str
) -> None:
    assert client.post("/encode", content=photo, headers={"Content-Type": content_type}).status_code == 201


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WEBP"])
def test_encode_of_a_form_accepts_every_image_type(client: httpx.Client, kind: str) -> None:
    files = {"image": ("photo.bin", image_file(disc(), kind), "application/octet-stream")}
    assert client.post("/encode", files=files).status_code == 201


def test_encode_of_a_form_field_without_file_name_is_accepted(client: httpx.Client, photo: bytes) -> None:
    body = b'--xyz\r\nContent-Disposition: form-data; name="image"\r\n\r\n' + photo + b"\r\n--xyz--\r\n"
    headers = {"Content-Type": "multipart/form-data; boundary=xyz"}
    assert client.post("/encode", content=body, headers=headers).status_code == 201


FORM = "multipart/form-data; boundary=xyz"
PART = b'--xyz\r\nContent-Disposition: form-data; name="image"; filename="a"\r\n\r\nabc\r\n'


@pytest.mark.parametrize(
    ("content_type", "body", "status", "field"),
    [
        ("image/png", b"", 415, "image"),
        ("image/png", b"GIF89a" + bytes(100), 415, "image"),
        ("image/png", b"%PDF-1.7", 415, "image"),
        ("image/png", image_file(disc())[:200], 400, "image"),
        ("image/png", b"\xff\xd8\xff" + bytes(100), 400, "image"),
        ("image/png", image_file(Image.new("RGB", (1001, 1000))), 413, "image"),
        ("image/png", image_file(Image.new("RGB", (64, 64), "white")), 422, "image"),
        ("image/png", bytes(200_001), 413, None),
        (FORM, b"", 400, "image"),
        (FORM, b"nonsense", 400, "image"),
        (FORM, PART, 400, "image"),
        (FORM, PART + b"--xyz", 400, "image"),
        (FORM, b"--xyz\r\n\r\nabc\r\n--xyz--\r\n", 400, "image"),
        (FORM, b"--xyz--\r\n", 422, "image"),
        (FORM, PART.replace(b'"image"', b'"picture"') + b"--xyz--\r\n", 422, "picture"),
        (FORM, PART + PART + b"--xyz--\r\n", 422, "image"),
        (FORM, PART * 9 + b"--xyz--\r\n", 422, "image"),
        (FORM, PART + PART.replace(b"abc", b"abd") + b"--xyz--\r\n", 415, "image"),
        (FORM, PART + b"--xyz--\r\n", 415, "image"),
        (FORM, PART.replace(b"abc", bytes(200_001)) + b"--xyz--\r\n", 413, "image"),
        (FORM, bytes(300_000), 413, None),
        ("multipart/form-data", PART + b"--xyz--\r\n", 400, "image"),
    ],
)
def test_encode_of_a_bad_body_is_refused_and_stores_nothing(
    client: httpx.Client, content_type: str, body: bytes, status: int, field: str | None
) -> None:
    answer = client.post("/encode", content=body, headers={"Content-Type": content_type})
    problem = answer.json()
    assert answer.status_code == problem["status"] == status
    assert answer.headers["content-type"] == "application/problem+json"
    assert [error["field"] for error in problem.get("errors", [])] == ([field] if field else [])
    assert _ids(client) == []


@pytest.mark.parametrize(
    ("query", "field"),
    [
        ("stroe=false", "stroe"),
        ("store=maybe", "store"),
        ("background=blur", "background"),
        ("foreground_ratio=0.09", "foreground_ratio"),
        ("foreground_ratio=1.01", "foreground_ratio"),
        ("foreground_ratio=nan", "foreground_ratio"),
        ("include=everything", "include"),
        ("model=other", "model"),
        ("store=true&store=false", "store"),
    ],
)
def test_encode_with_a_bad_parameter_names_it_and_stores_nothing(
    client: httpx.Client, photo: bytes, query: str, field: str
) -> None:
    answer = client.post(f"/encode?{query}", content=photo)
    assert answer.status_code == 422
    assert [error["field"] for error in answer.json()["errors"]] == [field]
    assert _ids(client) == []


def test_encode_with_background_remove_and_no_method_answers_422(client: httpx.Client) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)
    photo = image_file(Image.fromarray(noise))
    refused = client.post("/encode?background=remove", content=photo)
    assert refused.status_code == 422
    assert [error["field"] for error in refused.json()["errors"]] == ["background"]
    assert "HOF_MATTING_MODEL=none" in refused.json()["detail"]
    answer = client.post("/encode", content=photo)
    assert answer.status_code == 201
    assert answer.json()["image"] == {"mask": "none", "box": [0, 0, 64, 64], "width": 64, "height": 64}


def _connect(server: Server) -> socket.socket:
    return socket.create_connection(("127.0.0.1", server.port), timeout=30)


def _answer(connection: socket.socket) -> bytes:
    """Bytes that the server sends until it closes."""
    received = b""
    while piece := connection.recv(65_536):
        received += piece
    return received


def test_encode_with_content_length_over_the_limit_is_refused_early(server: Server) -> None:
    with _connect(server) as connection:
        connection.sendall(b"POST /encode HTTP/1.1\r\nHost: x\r\nContent-Length: 200001\r\n\r\n")
        answer = _answer(connection)
    assert answer.startswith(b"HTTP/1.1 413 ")
    assert b"connection: close" in answer.lower()


def test_encode_of_an_endless_chunked_body_is_refused_at_the_limit(server: Server, settings: Settings) -> None:
    chunk = bytes(10_000)
    framed = b"%x\r\n%b\r\n" % (len(chunk), chunk)
    sent = 0
    with _connect(server) as connection:
        connection.sendall(b"POST /encode HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n")
        with contextlib.suppress(ConnectionError):  # the server hangs up
            while sent < 1_000 * settings.max_image_bytes:
                connection.sendall(framed)
                sent += len(chunk)
    assert sent < 100 * settings.max_image_bytes  # what the sockets' buffers hold, and the limit


def test_encode_of_a_chunked_body_just_over_the_limit_is_answered(server: Server) -> None:
    with _connect(server) as connection:
        connection.sendall(b"POST /encode HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n")
        connection.sendall(b"%x\r\n%b\r\n" % (200_001, bytes(200_001)))
        assert _answer(connection).startswith(b"HTTP/1.1 413 ")


@pytest.mark.filterwarnings("ignore")  # a connection that is reset, in the server's thread
def test_encode_of_an_upload_that_breaks_off_stores_nothing(server: Server, client: httpx.Client, photo: bytes) -> None:
    for linger in (struct.pack("ii", 0, 0), struct.pack("ii", 1, 0)):  # closed, and reset
        with _connect(server) as connection:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger)
            connection.sendall(b"POST /encode HTTP/1.1\r\nHost: x\r\nContent-Length: %d\r\n\r\n" % len(photo))
            connection.sendall(photo[: len(photo) // 2])
            time.sleep(0.05)
    assert client.get("/health/ready").status_code == 200
    assert _ids(client) == []
    assert client.post("/encode", content=photo).status_code == 201
