"""Surfaces with colors over a real socket: the content of each format, and what other programs read from it."""

import io
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import numpy.typing as npt
import pytest
import trimesh
from scipy.spatial import cKDTree

from service import cli
from service.formats.mesh.registry import MESH_FORMATS
from service.formats.weights import load
from service.mapping.spec import apply, compose, word_of
from service.mapping.surface import shells
from tests.support.gltf import check_valid
from tests.support.small.colored_objects import check_none_leaves_color_out, encoded, file_of
from tests.support.usd import check_valid as check_usdz
from tests.support.usd import read as read_usdz

RESOLUTION = 16
COLORED = [name for name, fmt in MESH_FORMATS.items() if fmt.holds_color]

Levels = npt.NDArray[np.float64]  # sRGB, 0 to 255


def _file(client: httpx.Client, item: dict[str, Any], name: str, **query: int | str) -> bytes:
    return file_of(client, item, "mesh", format=name, resolution=RESOLUTION, **query)


def _read(data: bytes, name: str) -> tuple[trimesh.Trimesh, Levels]:
    """Return what an independent reader gets from a file: the mesh, and the colors of its vertices."""
    if name == "usdz":
        mesh = read_usdz(data)
        return mesh, _levels(mesh.vertex_attributes["color"])
    (mesh,) = trimesh.load_scene(io.BytesIO(data), file_type=name, process=False).geometry.values()
    if name not in ("glb", "gltf"):
        return mesh, mesh.visual.vertex_colors[:, :3].astype(np.float64)
    return mesh, _levels(mesh.visual.vertex_attributes["color"])


def _levels(color: npt.NDArray[Any]) -> Levels:
    """Return the sRGB levels of linear colors, as glTF and USD hold them."""
    linear = color.astype(np.float64)
    levels: Levels = 255 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return levels


@pytest.mark.parametrize("word", [["red"], ["red", "blue"]])
def test_mesh_vertices_have_the_colors_of_their_canonical_points(colored: httpx.Client, word: list[str]) -> None:
    """The color of a word is the mean of its functions' colors."""
    item = encoded(colored, word[0])
    if len(word) > 1:
        ids = [encoded(colored, color)["id"] for color in word]
        item = colored.post("/compose", json={"objects": ids}).json()
    weights = load(colored.get(item["links"]["weights"]).content)
    assert weights.color
    canonical, _ = shells(weights.spec.domain, RESOLUTION)
    mesh, levels = _read(_file(colored, item, "ply", frame="raw"), "ply")
    places = compose(weights.spec, word_of(weights.spec, weights.theta), canonical)
    distances, index = cKDTree(places).query(mesh.vertices)
    assert distances.max() < 1e-5
    functions = np.atleast_2d(weights.color.weights)
    assert len(functions) == len(word)
    values = [np.clip(apply(weights.color.spec, row, canonical[index]), 0, 1) for row in functions]
    assert np.std(values, axis=1).max() > 0.1
    assert np.abs(values[0] - values[-1]).max() > 0.2 or len(word) == 1
    assert np.abs(levels - 255 * np.mean(values, axis=0)).max() < 0.502


@pytest.mark.parametrize("name", COLORED)
def test_mesh_in_every_format_gives_other_programs_the_same_colors(colored: httpx.Client, name: str) -> None:
    item = encoded(colored)
    ply, levels = _read(_file(colored, item, "ply"), "ply")
    mesh, read = _read(_file(colored, item, name), name)
    np.testing.assert_allclose(mesh.triangles, ply.triangles, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(read[mesh.faces], levels[ply.faces], atol=0.01)


@pytest.mark.parametrize("name", ["glb", "gltf"])
def test_colored_mesh_as_gltf_passes_the_khronos_validator(colored: httpx.Client, name: str, tmp_path: Path) -> None:
    data = _file(colored, encoded(colored), name)
    assert b"COLOR_0" in data
    assert b'"baseColorFactor":[1.0,1.0,1.0,1.0]' in data  # anything else would tint the colors
    assert check_valid(data, tmp_path)["info"]["totalTriangleCount"] > 1000


def test_colored_mesh_as_usdz_has_a_material_of_the_vertices_colors(colored: httpx.Client) -> None:
    scene = check_usdz(_file(colored, encoded(colored), "usdz"))
    assert "inputs:diffuseColor.connect = </Object/Material/Color.outputs:result>" in scene
    assert 'inputs:varname = "displayColor"' in scene


@pytest.mark.parametrize("name", MESH_FORMATS)
def test_mesh_with_color_none_is_the_file_of_a_model_without_color(
    client: httpx.Client, colored: httpx.Client, name: str
) -> None:
    holds_color = MESH_FORMATS[name].holds_color
    check_none_leaves_color_out(client, colored, "mesh", holds_color, format=name, resolution=RESOLUTION)


def test_mesh_etag_depends_on_color(colored: httpx.Client) -> None:
    link = encoded(colored)["links"]["mesh"]
    tags = [colored.head(f"{link}?color={color}").headers["etag"] for color in ("auto", "none")]
    assert len(set(tags)) == 2
    assert colored.get(f"{link}?color=none", headers={"If-None-Match": tags[1]}).status_code == 304
    assert colored.get(link, headers={"If-None-Match": tags[1]}).status_code == 200


@pytest.mark.parametrize("color", ["auto", "none"])
@pytest.mark.parametrize("name", MESH_FORMATS)
def test_mesh_by_the_command_line_has_the_colors_of_the_service(
    colored: httpx.Client, tmp_path: Path, name: str, color: str
) -> None:
    item = encoded(colored)
    file, out = tmp_path / "a.safetensors", tmp_path / f"a.{name}"
    file.write_bytes(colored.get(item["links"]["weights"]).content)
    command = ["mesh", str(file), "-o", str(out), "--resolution", str(RESOLUTION), "--color", color]
    assert cli.main(command) == 0
    assert out.read_bytes() == _file(colored, item, name, color=color)
