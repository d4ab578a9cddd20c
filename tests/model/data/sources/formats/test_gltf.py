"""Base colors of glTF: texture, factor and vertex colors multiplied, and the texture's placement."""

import importlib.util
from pathlib import Path
from typing import Any

import DracoPy  # type: ignore[import-not-found]
import numpy as np
import pytest
import trimesh

from model.data.rendering.surface import material_color, material_image, vertex_colors
from model.data.sources.formats.assets import Assets
from model.data.sources.formats.gltf import read_gltf
from tests.support.small.meshes import box, data_uri, write_gltf, write_image


def load(path: Path) -> tuple[trimesh.Trimesh, list[str]]:
    (part,), losses = read_gltf(path.read_bytes(), Assets(path, path.parent))
    return part, losses


def textured(folder: Path, pbr: dict[str, Any], **changes: Any) -> Path:  # noqa: ANN401 - JSON
    """Write a box with a gray texture, 128 in sRGB."""
    write_image(folder / "gray.png", (128, 128, 128))
    image = {"uri": data_uri((folder / "gray.png").read_bytes()), "name": "gray"}
    corners = len(box(0).vertices)
    document = {
        "material": {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, **pbr}},
        "textures": [{"source": 0}],
        "images": [image],
        "uv": np.tile([0.25, 0.1], (corners, 1)),
        **changes,
    }
    write_gltf(folder / "box.gltf", 0, **document)
    return folder / "box.gltf"


def test_read_gltf_factor_multiplies_the_texture_in_linear_light(tmp_path: Path) -> None:
    part, losses = load(textured(tmp_path, {"baseColorFactor": [1, 0.5, 0, 1]}))
    image = material_image(part)
    assert image is not None
    assert image.getpixel((0, 0)) == (128, 92, 0)  # half of 0.216 is 0.108, 0.363 in sRGB
    assert losses == []


def test_read_gltf_vertex_colors_multiply_the_texture(tmp_path: Path) -> None:
    colors = np.tile([0.5, 1, 1], (len(box(0).vertices), 1))
    colors[0] = 0
    part, _ = load(textured(tmp_path, {}, colors=colors))
    assert material_image(part) is not None
    tint = vertex_colors(part)
    assert tint is not None
    assert tint[:2].tolist() == [[0, 0, 0], [188, 255, 255]]


def test_read_gltf_texture_transform_moves_the_coordinates(tmp_path: Path) -> None:
    transform = {"offset": [0.1, 0.2], "scale": [2, 3]}
    reference = {"index": 0, "extensions": {"KHR_texture_transform": transform}}
    path = textured(tmp_path, {"baseColorTexture": reference}, extensionsRequired=["KHR_texture_transform"])
    part, _ = load(path)
    assert part.visual.uv[0] == pytest.approx([0.25 * 2 + 0.1, 1 - (0.1 * 3 + 0.2)])


@pytest.mark.parametrize(
    ("changes", "loss"),
    [
        ({"images": [{"uri": "oak%201.png"}]}, "oak%201.png is missing or cannot be read"),
        ({"images": [{"uri": data_uri(b"no image"), "name": "oak"}]}, "oak is missing or cannot be read"),
        ({"images": [{"uri": data_uri(b"no image"), "mimeType": "image/ktx2"}]}, "texture 0 is missing or cannot be"),
    ],
)
def test_read_gltf_lost_texture_is_named_and_the_factor_stays(
    tmp_path: Path, changes: dict[str, Any], loss: str
) -> None:
    part, losses = load(textured(tmp_path, {"baseColorFactor": [1, 0, 0, 1]}, **changes))
    assert [each[: len(loss)] for each in losses] == [loss]
    assert material_image(part) is None
    assert material_color(part)[0].tolist() == [255, 0, 0]


@pytest.mark.parametrize(("mode", "opacity"), [("BLEND", 0.2), ("OPAQUE", 1)])
def test_read_gltf_alpha_counts_where_it_blends(tmp_path: Path, mode: str, opacity: float) -> None:
    material = {"alphaMode": mode, "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.2]}}
    write_gltf(tmp_path / "box.gltf", 0, material=material)
    assert material_color(load(tmp_path / "box.gltf")[0])[1] == pytest.approx(opacity)


def test_read_gltf_draco_without_decoder_names_extension_and_remedy(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    write_gltf(tmp_path / "box.gltf", 0, extensionsRequired=["KHR_draco_mesh_compression"])
    with pytest.raises(ValueError, match=r"needs KHR_draco_mesh_compression, .* export it without or install DracoPy"):
        load(tmp_path / "box.gltf")


def test_read_gltf_draco_gives_shape_and_color(tmp_path: Path) -> None:
    solid = box(0)
    data = DracoPy.encode(solid.vertices, solid.faces, quantization_bits=14)
    (position,) = DracoPy.decode(data).attributes
    compressed = {"bufferView": 0, "attributes": {"POSITION": position["unique_id"]}}
    primitive = {
        "attributes": {"POSITION": 0},
        "indices": 1,
        "material": 0,
        "extensions": {"KHR_draco_mesh_compression": compressed},
    }
    write_gltf(
        tmp_path / "box.gltf",
        0,
        extensionsUsed=["KHR_draco_mesh_compression"],
        extensionsRequired=["KHR_draco_mesh_compression"],
        material={"pbrMetallicRoughness": {"baseColorFactor": [1, 0, 0, 1]}},
        meshes=[{"primitives": [primitive]}],
        accessors=[
            {"componentType": 5126, "count": len(solid.vertices), "type": "VEC3"},
            {"componentType": 5123, "count": solid.faces.size, "type": "SCALAR"},
        ],
        bufferViews=[{"buffer": 0, "byteOffset": 0, "byteLength": len(data)}],
        buffers=[{"byteLength": len(data), "uri": data_uri(data)}],
    )
    part, losses = load(tmp_path / "box.gltf")
    assert losses == []
    assert part.is_watertight
    assert part.volume == pytest.approx(solid.volume, rel=1e-3)
    np.testing.assert_allclose(part.bounds, solid.bounds, atol=1e-3 * np.ptp(solid.bounds))
    assert material_color(part)[0].tolist() == [255, 0, 0]
