"""GET /objects/{id}/points over a real socket."""

import io
import json
import re
import socket
import time
import tracemalloc
from typing import get_args

import httpx
import numpy as np
import pytest
import trimesh

from service.api.queries import PointFormatName, PointsQuery
from service.formats.points.registry import POINT_FORMATS
from service.formats.weights import load
from service.mapping import cloud as cloud_module
from service.mapping.canonical import canonical_points
from service.mapping.cloud import FIRST_PART, PART, Cloud, Part
from service.mapping.spec import Array, Functions, MappingSpec, initial_theta, power
from service.settings import Settings
from tests.support.server import Server, check_refused, running


@pytest.fixture
def path(client: httpx.Client, photo: bytes) -> str:
    points: str = client.post("/encode", content=photo).json()["links"]["points"]
    return points


def _npy(client: httpx.Client, path: str, **query: float | str) -> Array:
    answer = client.get(path, params={"format": "npy", **query})
    assert answer.status_code == 200
    array: Array = np.load(io.BytesIO(answer.content))
    return array


def test_points_of_an_object_are_those_of_its_mapping_function(client: httpx.Client, path: str) -> None:
    weights = load(client.get(path.replace("points", "weights")).content)
    expected = power(weights.spec, weights.theta, canonical_points("ball", 5000, seed=7))
    np.testing.assert_allclose(_npy(client, path, n=5000, seed=7, frame="raw"), expected, atol=1e-5)


@pytest.mark.parametrize("scale", [1, 0.8, 250.0])
def test_points_of_the_object_frame_are_centered_and_as_long_as_scale(
    client: httpx.Client, path: str, scale: float
) -> None:
    stored = client.get(path.removesuffix("/points")).json()
    low, high = (np.array(stored["frame"][name], np.float32) for name in ("low", "high"))
    unit = (high - low).max()
    assert stored["dimensions"] == pytest.approx((high - low) / unit, rel=1e-6)
    assert max(stored["dimensions"]) == 1
    points, raw = _npy(client, path, n=200_000, scale=scale), _npy(client, path, n=200_000, frame="raw")
    np.testing.assert_allclose(points, (raw - (low + high) / 2) * (scale / unit), atol=1e-5 * scale)
    reached = np.array([points.min(axis=0), points.max(axis=0)]) / scale
    half = np.array(stored["dimensions"]) / 2
    np.testing.assert_allclose(reached, [-half, half], atol=0.03)  # random points do not quite reach the box


def test_points_of_any_seed_and_count_share_one_frame(client: httpx.Client, path: str) -> None:
    raw = [_npy(client, path, n=n, seed=seed, frame="raw") for n, seed in ((10, 1), (5000, 2))]
    framed = [_npy(client, path, n=n, seed=seed) for n, seed in ((10, 1), (5000, 2))]
    factors = [np.ptp(a, axis=0) / np.ptp(b, axis=0) for a, b in zip(framed, raw, strict=True)]
    np.testing.assert_allclose(factors[0], factors[1], rtol=1e-3)


@pytest.mark.parametrize("n", [1, FIRST_PART, FIRST_PART + 1, FIRST_PART + PART + 777])
def test_points_of_any_part_are_bitwise_equal(client: httpx.Client, path: str, n: int) -> None:
    cloud = _npy(client, path, n=100_000, seed=3)
    np.testing.assert_array_equal(_npy(client, path, n=n, seed=3), cloud[:n])
    np.testing.assert_array_equal(_npy(client, path, n=n, seed=3, offset=20_001), cloud[20_001 : 20_001 + n])


def test_points_in_every_format_are_the_same(client: httpx.Client, path: str) -> None:
    n = FIRST_PART + 100
    expected = _npy(client, path, n=n)
    files = {name: client.get(path, params={"format": name, "n": n}) for name in POINT_FORMATS}
    ply = trimesh.load(io.BytesIO(files["ply"].content), file_type="ply").vertices
    glb = trimesh.load(io.BytesIO(files["glb"].content), file_type="glb").to_geometry().vertices
    xyz = np.loadtxt(io.BytesIO(files["xyz"].content))
    loaded = json.loads(files["json"].content)
    np.testing.assert_array_equal(np.float32(ply), expected)
    np.testing.assert_array_equal(np.float32(glb), expected)
    np.testing.assert_allclose(xyz, expected, rtol=1e-5)
    np.testing.assert_array_equal(np.float32(loaded["points"]), expected)
    assert loaded["n"] == n
    for name, answer in files.items():
        assert answer.headers["content-type"].split(";")[0] == POINT_FORMATS[name].media_type
        assert re.fullmatch(
            rf'attachment; filename="hof-[0-9a-f]{{32}}\.{name}"', answer.headers["content-disposition"]
        )
        length = POINT_FORMATS[name].length(n)
        assert answer.headers.get("content-length") == (None if length is None else str(length))


def test_points_by_default_are_ten_thousand_of_seed_zero_as_ply(client: httpx.Client, path: str) -> None:
    plain = client.get(path)
    assert plain.headers["content-type"] == "model/ply"
    assert plain.content == client.get(f"{path}?n=10000&seed=0&scale=1&offset=0&format=ply").content
    assert plain.content != client.get(f"{path}?seed=1").content


def test_points_with_scale_are_multiplied(client: httpx.Client, path: str) -> None:
    np.testing.assert_allclose(_npy(client, path, n=50, scale=2.5), 2.5 * _npy(client, path, n=50), rtol=1e-6)


@pytest.mark.parametrize(
    ("accept", "query", "expected"),
    [
        ("application/json", "", "application/json"),
        ("application/json", "?format=xyz", "text/plain"),
        ("model/*;q=0.5, application/x-npy", "", "application/x-npy"),
        ("*/*", "", "model/ply"),
        ("image/png", "?format=glb", "model/gltf-binary"),
    ],
)
def test_points_with_format_and_accept_use_format(
    client: httpx.Client, path: str, accept: str, query: str, expected: str
) -> None:
    answer = client.get(path + query, headers={"Accept": accept})
    assert answer.headers["content-type"].split(";")[0] == expected
    assert answer.headers["vary"].startswith("Accept")


def test_points_with_an_unsatisfiable_accept_answer_406(client: httpx.Client, path: str) -> None:
    answer = client.get(path, headers={"Accept": "image/png"})
    assert (answer.status_code, answer.headers["content-type"]) == (406, "application/problem+json")


@pytest.mark.parametrize(
    ("query", "field", "limit"),
    [
        ("n=0", "n", "1"),
        ("n=10000001", "n", "10000000"),
        ("n=-5", "n", "1"),
        ("n=ten", "n", "integer"),
        ("n=1.5", "n", "integer"),
        ("n=100001&format=json", "n", "100000"),
        ("seed=-1", "seed", "0"),
        ("seed=9223372036854775808", "seed", "9223372036854775807"),
        ("offset=-1", "offset", "0"),
        ("offset=9007199254740993", "offset", "9007199254740992"),
        ("scale=0", "scale", "greater"),
        ("scale=-1", "scale", "greater"),
        ("scale=inf", "scale", "1000000000"),
        ("scale=nan", "scale", "or equal"),
        ("format=stl", "format", "ply"),
        ("N=5", "N", "unknown"),
        ("n=5&n=6", "n", "once"),
    ],
)
def test_points_with_a_bad_parameter_name_it_and_its_limit(
    client: httpx.Client, path: str, query: str, field: str, limit: str
) -> None:
    check_refused(client.get(f"{path}?{query}"), field, limit)


def test_points_at_the_ends_of_the_ranges_are_allowed(client: httpx.Client, path: str) -> None:
    cloud = _npy(client, path, n=1, seed=2**63 - 1, offset=2**53, scale=1e9)
    assert np.isfinite(cloud).all()


def test_points_with_a_lower_max_points_setting_are_limited(settings: Settings, photo: bytes) -> None:
    lowered = settings.model_copy(update={"max_points": 100})
    with running(lowered) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}") as client:
        path = client.post("/encode", content=photo).json()["links"]["points"]
        assert client.get(f"{path}?n=100").status_code == 200
        answer = client.get(f"{path}?n=101")
    assert (answer.status_code, answer.json()["errors"][0]["field"]) == (422, "n")
    assert "100" in answer.json()["detail"]


def test_head_of_points_computes_nothing(client: httpx.Client, path: str, monkeypatch: pytest.MonkeyPatch) -> None:
    get = client.get(path)
    monkeypatch.setattr(cloud_module, "Sampler", None)  # would fail
    head = client.head(path)
    assert (head.status_code, head.content) == (200, b"")
    for name in ("content-type", "content-length", "content-disposition"):
        assert head.headers[name] == get.headers[name]


def test_points_of_large_n_take_no_more_memory(client: httpx.Client, path: str) -> None:
    """Server and client share this process: neither holds the 24 MB of a cloud of two million."""
    with client.stream("GET", f"{path}?n=2000000&format=npy") as answer:
        tracemalloc.start()
        try:
            received = sum(len(piece) for piece in answer.iter_raw())
            _, peak = tracemalloc.get_traced_memory()
        finally:
            tracemalloc.stop()
    assert received == 2_000_000 * 12 + 128
    assert peak < 12_000_000


def _sampled_parts(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Record the sizes of the parts that are sampled from now on."""
    sizes: list[int] = []
    original = Cloud.points

    def counting(self: Cloud, part: Part) -> Array:
        sizes.append(part[1])
        return original(self, part)

    monkeypatch.setattr(Cloud, "points", counting)
    return sizes


@pytest.mark.parametrize("name", ["npy", "glb"])
def test_points_of_a_client_that_leaves_stop_sampling(
    server: Server, path: str, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    sizes = _sampled_parts(monkeypatch)
    with socket.create_connection(("127.0.0.1", server.port), timeout=30) as connection:
        connection.sendall(f"GET {path}?n=10000000&format={name} HTTP/1.1\r\nHost: x\r\n\r\n".encode())
        deadline = time.monotonic() + 30
        while not sizes:  # glb is in its pass for the bounds then, before a byte is sent
            assert time.monotonic() < deadline, "no part was ever sampled"
            time.sleep(0.001)
    before = -1
    while before != len(sizes):
        before = len(sizes)
        time.sleep(0.5)
    assert 0 < sum(sizes) < 5_000_000


def test_point_format_names_of_the_schema_are_those_of_the_formats() -> None:
    assert get_args(PointFormatName) == tuple(POINT_FORMATS)
    assert PointsQuery(n=10_000_000).n == 10_000_000


@pytest.mark.parametrize("offset", [0, 1, 4095, 4096, 100_001])
@pytest.mark.parametrize("n", [1, 4096, 4097, 70_000, 200_000])
def test_cloud_parts_cover_the_points_once(n: int, offset: int) -> None:
    spec = MappingSpec("small", 3, (4,), 3)
    parts = list(Cloud(spec, Functions(initial_theta(spec)), n, offset=offset).parts())
    ends = [start + count for start, count in parts]
    assert [start for start, _ in parts] == [0, *ends[:-1]]
    assert ends[-1] == n
    assert all(0 < count <= PART for _, count in parts)
    assert parts[0][1] <= FIRST_PART


def test_points_with_sobol_cover_the_object_more_evenly(client: httpx.Client, path: str) -> None:
    uniform, sobol = _npy(client, path, n=4096), _npy(client, path, n=4096, sampling="sobol")
    assert not np.array_equal(uniform, sobol)
    np.testing.assert_array_equal(_npy(client, path, n=96, offset=4000, sampling="sobol"), sobol[4000:])
    reference = _npy(client, path, n=1_000_000).mean(axis=0)
    assert np.linalg.norm(sobol.mean(axis=0) - reference) < 0.3 * np.linalg.norm(uniform.mean(axis=0) - reference)


def test_points_with_sobol_past_its_sequence_are_refused(client: httpx.Client, path: str) -> None:
    assert client.get(f"{path}?sampling=sobol&n=10&offset={2**32 - 10}").status_code == 200
    answer = client.get(f"{path}?sampling=sobol&n=11&offset={2**32 - 10}")
    assert (answer.status_code, answer.json()["errors"][0]["field"]) == (422, "offset")
    assert "2**32" in answer.json()["detail"]
