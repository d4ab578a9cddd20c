"""Colored point clouds as files: their bytes, and what other programs read from them."""

import base64
import io
import json
import struct

import numpy as np
import pytest
import trimesh

from service.formats.points.registry import POINT_FORMATS
from service.formats.points.writer import write
from service.mapping.canonical import canonical_points
from tests.support.small.clouds import COLORED, FORMATS, TWO, ArrayCloud, colored, colors_of, file_of


def test_write_as_colored_ply_gives_these_bytes() -> None:
    colors = colors_of(2)
    header = (
        b"ply\nformat binary_little_endian 1.0\ncomment +Y is up, the front faces +Z\nelement vertex 2\n"
        b"property float x\nproperty float y\nproperty float z\n"
        b"property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n"
    )
    rows = (struct.pack("<3f3B", *point, *color) for point, color in zip(TWO, colors, strict=True))
    assert file_of(colored("ply"), TWO) == header + b"".join(rows)


def test_write_as_colored_pcd_gives_these_bytes() -> None:
    data = file_of(colored("pcd"), TWO)
    head, _, body = data.partition(b"DATA binary\n")
    assert b"FIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 1\nWIDTH 2\n" in head
    packed = [red << 16 | green << 8 | blue for red, green, blue in colors_of(2).tolist()]
    rows = (struct.pack("<3fI", *point, rgb) for point, rgb in zip(TWO, packed, strict=True))
    assert body == b"".join(rows)


@pytest.mark.parametrize("chunk", [1, 2])
def test_write_as_colored_json_gives_these_bytes(chunk: int) -> None:
    data = file_of(colored("json"), TWO, chunk)
    plain = file_of(POINT_FORMATS["json"], TWO)
    assert data.startswith(plain.removesuffix(b"]}\n") + b'],"colors":[[')
    assert json.loads(data) == json.loads(plain) | {"colors": colors_of(2).tolist()}


@pytest.mark.parametrize("name", ["glb", "gltf"])
def test_write_as_colored_gltf_gives_linear_light(name: str) -> None:
    levels = np.arange(256, dtype=np.uint8).repeat(3).reshape(-1, 3)
    points = canonical_points("ball", 256)
    data = b"".join(write(colored(name), ArrayCloud(points, levels)))
    if name == "glb":
        (size,) = struct.unpack_from("<I", data, 12)
        document, binary = json.loads(data[20 : 20 + size]), data[28 + size :]
    else:
        document = json.loads(data)
        binary = base64.b64decode(document["buffers"][0]["uri"].partition(",")[2])
    assert len(binary) == document["buffers"][0]["byteLength"] == 256 * 24
    assert document["bufferViews"][0]["byteStride"] == 24
    rows = np.frombuffer(binary, "<f4").reshape(256, 6)
    np.testing.assert_array_equal(rows[:, :3], points)
    linear = rows[:, 3:].astype(np.float64)
    srgb = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    np.testing.assert_array_equal(np.rint(255 * srgb), levels)
    assert document["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] == [1, 1, 1, 1]
    assert document["meshes"][0]["primitives"][0]["attributes"] == {"POSITION": 0, "COLOR_0": 1}


@pytest.mark.parametrize("name", ["ply", "glb", "gltf"])
def test_write_with_colors_gives_another_program_the_points(name: str) -> None:
    points = canonical_points("ball", 2500)
    scene = trimesh.load_scene(io.BytesIO(file_of(colored(name), points)), file_type=name)
    np.testing.assert_array_equal(np.float32(scene.to_geometry().vertices), points)


def test_write_as_colored_ply_gives_another_program_the_colors() -> None:
    cloud = trimesh.load(io.BytesIO(file_of(colored("ply"), canonical_points("ball", 2500))), file_type="ply")
    np.testing.assert_array_equal(cloud.colors[:, :3], colors_of(2500))


def test_colored_formats_are_these() -> None:
    assert [fmt.name for fmt in COLORED] == ["ply", "json", "glb", "gltf", "pcd"]
    for fmt in FORMATS:
        assert fmt.holding(color=False) is fmt
        assert fmt.holding(color=True) is (fmt.colored or fmt)
