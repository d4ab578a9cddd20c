"""A service that keeps float16: shipped models, points within a thousandth of the longest side, honest ETags."""

import base64
import json
import sqlite3
import struct
from collections.abc import Iterator
from pathlib import Path

import httpx
import numpy as np
import pytest

from service.formats.weights import Weights, dump, load
from service.mapping.spec import initial_theta
from service.settings import SHIPPED_MODEL, Settings
from tests.support import ROOT
from tests.support.server import running

PHOTOS = sorted((ROOT / "service" / "viewer" / "static" / "photos").glob("*.webp"))
POINTS = 20_000
LARGEST = 1e-3  # of the longest side, which is 1


@pytest.fixture(scope="module")
def clients(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[httpx.Client, httpx.Client, Path]]:
    """Run two services with the shipped model, float32 and float16; the folder of the second one's database."""
    folder = tmp_path_factory.mktemp("stores")
    settings = [
        Settings(
            model=(SHIPPED_MODEL,), database_url=f"sqlite:///{folder}/{dtype}.db", store_dtype=dtype, matting_model=None
        )
        for dtype in ("float32", "float16")
    ]
    with running(settings[0]) as whole, running(settings[1]) as half:
        urls = [f"http://127.0.0.1:{server.port}" for server in (whole, half)]
        with httpx.Client(base_url=urls[0], timeout=60) as first, httpx.Client(base_url=urls[1], timeout=60) as second:
            yield first, second, folder / "float16.db"


def _encode(client: httpx.Client, photo: Path) -> str:
    answer = client.post("/encode", content=photo.read_bytes()).raise_for_status()
    object_id: str = answer.json()["id"]
    return object_id


def _points(client: httpx.Client, object_id: str) -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    answer = client.get(f"/objects/{object_id}/points", params={"n": POINTS, "format": "f32"}).raise_for_status()
    return np.frombuffer(answer.content, "<f4").reshape(-1, 3)


def _weights(client: httpx.Client, object_id: str, dtype: str = "float32") -> bytes:
    return client.get(f"/objects/{object_id}/weights", params={"dtype": dtype}).raise_for_status().content


def _theta_bytes(path: Path, object_id: str) -> int:
    connection = sqlite3.connect(f"file:{path}?mode=ro", uri=True)
    try:
        ((size,),) = connection.execute("SELECT length(theta) FROM objects WHERE id = ?", (object_id,))
    finally:
        connection.close()
    return int(size)


@pytest.mark.parametrize("photo", PHOTOS, ids=lambda path: path.stem)
def test_object_in_float16_has_half_the_bytes_and_points_within_a_thousandth(
    clients: tuple[httpx.Client, httpx.Client, Path], photo: Path
) -> None:
    whole, half, path = clients
    object_id = _encode(half, photo)
    assert _encode(whole, photo) == object_id
    moved = np.linalg.norm(_points(half, object_id) - _points(whole, object_id), axis=1)
    size = load(_weights(half, object_id)).theta.size
    assert _theta_bytes(path, object_id) == 2 * size
    assert 0 < moved.max() <= LARGEST


def test_weights_of_an_object_in_float16_lose_nothing_as_float16(
    clients: tuple[httpx.Client, httpx.Client, Path],
) -> None:
    _, half, path = clients
    object_id = _encode(half, PHOTOS[0])
    file = _weights(half, object_id, "float16")
    weights = load(file)
    assert weights.loss
    assert (weights.loss.mean, weights.loss.largest) == (0, 0)
    np.testing.assert_array_equal(weights.theta, load(_weights(half, object_id)).theta)
    again = half.post("/objects", content=file).raise_for_status().json()
    assert _theta_bytes(path, again["id"]) == 2 * weights.theta.size
    (length,) = struct.unpack_from("<Q", file)
    assert json.loads(file[8 : 8 + length])["theta"]["dtype"] == "F16"


def test_answer_without_storing_has_the_numbers_that_the_object_would_have(
    clients: tuple[httpx.Client, httpx.Client, Path],
) -> None:
    for client in clients[:2]:
        answer = client.post("/encode?store=false", content=PHOTOS[1].read_bytes()).raise_for_status().json()
        stored = load(_weights(client, _encode(client, PHOTOS[1]))).theta
        np.testing.assert_array_equal(np.frombuffer(base64.b64decode(answer["weights"]), "<f4"), stored)


def test_etags_of_float16_and_float32_differ(clients: tuple[httpx.Client, httpx.Client, Path]) -> None:
    whole, half, _ = clients
    object_id = _encode(half, PHOTOS[0])
    assert _encode(whole, PHOTOS[0]) == object_id
    for part in ("points?n=100", "weights", "mesh?resolution=8&format=glb"):
        tags = [client.get(f"/objects/{object_id}/{part}").headers["etag"] for client in (whole, half)]
        assert tags[0] != tags[1]
        answer = half.get(f"/objects/{object_id}/{part}", headers={"If-None-Match": tags[0]})
        assert answer.status_code == 200  # what a cache holds of the other store is not this


def test_words_means_and_imports_of_float16_work(clients: tuple[httpx.Client, httpx.Client, Path]) -> None:
    whole, half, path = clients
    pair = [_encode(half, photo) for photo in PHOTOS[1:3]]
    word = half.post("/compose", json={"mode": "compose", "objects": pair}).raise_for_status().json()
    mean = half.post("/compose", json={"mode": "interpolate", "objects": pair}).raise_for_status().json()
    spec = load(_weights(half, pair[0])).spec
    file = dump(Weights(spec, initial_theta(spec, 1), "m"), "safetensors")
    imported = half.post("/objects", content=file).raise_for_status().json()
    assert half.post("/objects", content=file).json()["id"] == imported["id"]
    for stored in (mean, imported):
        assert _theta_bytes(path, stored["id"]) == 2 * spec.size
    whole_word = [_encode(whole, photo) for photo in PHOTOS[1:3]]
    other = whole.post("/compose", json={"mode": "compose", "objects": whole_word}).raise_for_status().json()
    assert other["id"] == word["id"]
    assert np.linalg.norm(_points(half, word["id"]) - _points(whole, word["id"]), axis=1).max() <= LARGEST
    for item in (word, mean, imported):
        points = _points(half, item["id"])
        assert np.isfinite(points).all()
        assert np.ptp(points, axis=0).max() == pytest.approx(1, abs=0.05)
    np.testing.assert_array_equal(
        load(_weights(half, word["id"])).theta, np.stack([load(_weights(half, name)).theta for name in pair])
    )
