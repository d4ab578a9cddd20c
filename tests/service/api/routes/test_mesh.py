"""GET /objects/{id}/mesh over a real socket."""

import io
import re
import zipfile
from pathlib import Path
from typing import get_args

import httpx
import numpy as np
import pytest
import trimesh

from service.api.queries import MeshFormatName
from service.formats.mesh.registry import MESH_FORMATS
from service.formats.weights import load
from service.mapping.sampler import Sampler
from service.mapping.spec import word_of
from service.mapping.surface import RESOLUTIONS, surface_of
from tests.support.gltf import check_valid
from tests.support.photos import disc, image_file
from tests.support.server import check_refused
from tests.support.usd import check_valid as check_usdz
from tests.support.usd import read as read_usdz


@pytest.fixture
def path(client: httpx.Client, photo: bytes) -> str:
    mesh: str = client.post("/encode", content=photo).json()["links"]["mesh"]
    return mesh


def _mesh(client: httpx.Client, path: str, name: str, **query: float) -> trimesh.Trimesh:
    """Read a file with an independent reader; vertices in the order of the file."""
    answer = client.get(path, params={"format": name, **query})
    assert answer.status_code == 200, answer.text
    if name == "usdz":
        return read_usdz(answer.content)
    loaded = trimesh.load(io.BytesIO(answer.content), file_type=name, process=False)
    (mesh,) = loaded.geometry.values() if isinstance(loaded, trimesh.Scene) else (loaded,)
    assert isinstance(mesh, trimesh.Trimesh)
    return mesh


def test_mesh_in_every_format_holds_the_same_triangles(client: httpx.Client, path: str) -> None:
    expected = _mesh(client, path, "glb", resolution=16)
    assert len(expected.faces) > 1000
    for name in MESH_FORMATS:
        mesh = _mesh(client, path, name, resolution=16)
        np.testing.assert_allclose(mesh.triangles, expected.triangles, rtol=1e-5, atol=1e-5, err_msg=name)


@pytest.mark.parametrize("name", ["glb", "gltf", "obj", "ply", "usdz"])
def test_mesh_file_holds_the_normals_of_the_surface(client: httpx.Client, path: str, name: str) -> None:
    weights = load(client.get(path.replace("mesh", "weights")).content)
    surface = surface_of(Sampler(weights.spec, word_of(weights.spec, weights.theta), weights.frame), 16)
    mesh = _mesh(client, path, name, resolution=16)
    expected = surface.normals[surface.triangles]  # (t, 3, 3)
    np.testing.assert_allclose(mesh.vertex_normals[mesh.faces], expected, atol=1e-4)


@pytest.mark.parametrize("name", ["glb", "gltf"])
def test_mesh_as_gltf_passes_the_khronos_validator(client: httpx.Client, path: str, name: str, tmp_path: Path) -> None:
    report = check_valid(client.get(path, params={"format": name}).content, tmp_path)
    assert report["info"]["totalTriangleCount"] > 1000


def test_mesh_as_usdz_passes_the_validators_of_openusd(client: httpx.Client, path: str) -> None:
    answer = client.get(path, params={"format": "usdz", "scale": 0.8})
    assert answer.headers["content-type"] == "model/vnd.usdz+zip"
    assert "+Y is up" in check_usdz(answer.content)
    assert np.ptp(read_usdz(answer.content).vertices, axis=0).max() == pytest.approx(0.8, rel=0.1)


def test_mesh_as_usdz_is_one_aligned_file_of_a_zip_without_compression(client: httpx.Client, path: str) -> None:
    content = client.get(path, params={"format": "usdz"}).content
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        (entry,) = archive.infolist()
        assert (entry.filename, entry.compress_type) == ("object.usdc", zipfile.ZIP_STORED)
        inside = archive.read(entry)
    assert content.index(inside) % 64 == 0
    assert content == client.get(path, params={"format": "usdz"}).content


def test_meshes_asked_for_on_one_connection_at_once_are_all_answered(client: httpx.Client, path: str) -> None:
    answers = [client.get(path, params={"format": "obj", "resolution": 16}) for _ in range(20)]
    assert {answer.status_code for answer in answers} == {200}
    assert len(answers[0].content) > 65_536  # several pieces


def test_mesh_of_an_object_lies_where_its_points_are(client: httpx.Client, path: str) -> None:
    points = np.load(io.BytesIO(client.get(path.replace("mesh", "points") + "?format=npy").content))
    mesh = _mesh(client, path, "glb")
    size = np.ptp(points, axis=0).max()
    np.testing.assert_allclose(mesh.bounds, [points.min(axis=0), points.max(axis=0)], atol=0.1 * size)
    distances = np.linalg.norm(points[:200, None] - mesh.vertices, axis=2).min(axis=1)
    assert np.quantile(distances, 0.9) < 0.1 * size


def test_mesh_by_default_is_glb_in_the_scaled_frame(client: httpx.Client, path: str) -> None:
    plain = client.get(path)
    assert plain.headers["content-type"] == "model/gltf-binary"
    assert re.fullmatch(r'attachment; filename="hof-[0-9a-f]{32}\.glb"', plain.headers["content-disposition"])
    assert plain.content == client.get(f"{path}?format=glb&scale=1").content
    single, double = (_mesh(client, path, "ply", resolution=16, scale=scale) for scale in (1, 2))
    np.testing.assert_allclose(double.vertices, 2 * single.vertices, rtol=1e-5)


@pytest.mark.parametrize(
    ("accept", "query", "expected"),
    [("model/obj", "", "model/obj"), ("model/obj", "?format=stl", "model/stl"), ("model/*", "", "model/gltf-binary")],
)
def test_mesh_with_format_and_accept_uses_format(
    client: httpx.Client, path: str, accept: str, query: str, expected: str
) -> None:
    answer = client.get(path + query, headers={"Accept": accept})
    assert (answer.headers["content-type"], answer.headers["vary"]) == (expected, "Accept")


def test_mesh_with_an_unsatisfiable_accept_answers_406(client: httpx.Client, path: str) -> None:
    answer = client.get(path, headers={"Accept": "text/plain"})
    assert (answer.status_code, answer.headers["content-type"]) == (406, "application/problem+json")
    assert "model/stl" in answer.json()["detail"]


@pytest.mark.parametrize(
    ("query", "field", "limit"),
    [
        (f"resolution={RESOLUTIONS[0] - 1}", "resolution", str(RESOLUTIONS[0])),
        (f"resolution={RESOLUTIONS[1] + 1}", "resolution", str(RESOLUTIONS[1])),
        ("resolution=fine", "resolution", "integer"),
        ("scale=0", "scale", "greater"),
        ("format=npy", "format", "stl"),
        ("color=red", "color", "'auto' or 'none'"),
        ("n=5", "n", "unknown"),
    ],
)
def test_mesh_with_a_bad_parameter_names_it_and_its_limit(
    client: httpx.Client, path: str, query: str, field: str, limit: str
) -> None:
    check_refused(client.get(f"{path}?{query}"), field, limit)


def test_mesh_of_an_unknown_object_answers_404(client: httpx.Client) -> None:
    assert client.get(f"/objects/{'0' * 32}/mesh").status_code == 404


def test_mesh_etag_differs_for_every_parameter(client: httpx.Client, path: str) -> None:
    queries = ["", "?resolution=9", "?scale=2", "?format=obj", "?format=stl", "?color=none"]
    assert len({client.head(path + query).headers["ETag"] for query in queries}) == len(queries)


def test_mesh_of_a_composed_object_is_its_own(client: httpx.Client, photo: bytes) -> None:
    first, second = (
        client.post("/encode", content=content).json()["id"] for content in (photo, image_file(disc("blue")))
    )
    word = client.post("/compose", json={"objects": [first, second]}).json()
    composed, plain = (
        _mesh(client, path, "glb", resolution=16) for path in (word["links"]["mesh"], f"/objects/{first}/mesh")
    )
    assert not np.array_equal(composed.vertices, plain.vertices)
    points = np.load(io.BytesIO(client.get(word["links"]["points"] + "?format=npy").content))
    np.testing.assert_allclose(composed.centroid, points.mean(axis=0), atol=0.2 * np.ptp(points))


def test_mesh_format_names_of_the_schema_are_those_of_the_formats() -> None:
    assert get_args(MeshFormatName) == tuple(MESH_FORMATS)
