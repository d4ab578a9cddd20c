import base64
import io
import json
import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh

from service.errors import InvalidParameter
from service.formats.points.registry import POINT_FORMATS, PointFormat
from service.formats.points.writer import write
from service.formats.raw import float32
from service.mapping.canonical import canonical_points
from service.mapping.cloud import Part, bounds
from service.mapping.spec import Array
from tests.support.gltf import check_valid, gltf_report
from tests.support.small.clouds import BINARY, EVERY, FORMATS, TEXT, TWO, ArrayCloud, colored, colors_of, file_of, label


def read(fmt: PointFormat, data: bytes) -> Array:
    """Read the points as another program does, (n, 3) float32."""
    match fmt.name:
        case "ply" | "glb" | "gltf":
            geometry = trimesh.load_scene(io.BytesIO(data), file_type=fmt.name).to_geometry()
            return np.asarray(geometry.vertices, np.float32)
        case "npy":
            return np.asarray(np.load(io.BytesIO(data), allow_pickle=False))
        case "pcd":
            head, _, body = data.partition(b"DATA binary\n")
            fields = dict(line.split(b" ", 1) for line in head.splitlines())
            assert (fields[b"FIELDS"], fields[b"SIZE"], fields[b"TYPE"]) == (b"x y z", b"4 4 4", b"F F F")
            return np.frombuffer(body, "<f4").reshape(int(fields[b"POINTS"]), 3)
        case "f32" | "f16":
            return np.frombuffer(data, f"<{fmt.name[0]}{int(fmt.name[1:]) // 8}").reshape(-1, 3).astype(np.float32)
        case "xyz":
            return np.loadtxt(io.BytesIO(data), dtype=np.float32, ndmin=2)
        case "json":
            return np.array(json.loads(data)["points"], np.float32)
    raise ValueError(fmt.name)


def test_point_formats_have_these_names() -> None:
    assert list(POINT_FORMATS) == ["ply", "npy", "xyz", "json", "glb", "gltf", "pcd", "f32", "f16"]
    assert all(name == fmt.name and fmt.extension == f".{name}" for name, fmt in POINT_FORMATS.items())


# Bytes


def test_write_as_ply_gives_these_bytes() -> None:
    header = (
        b"ply\nformat binary_little_endian 1.0\ncomment +Y is up, the front faces +Z\nelement vertex 2\n"
        b"property float x\nproperty float y\nproperty float z\nend_header\n"
    )
    assert file_of(POINT_FORMATS["ply"], TWO) == header + struct.pack("<6f", *TWO.ravel())


def test_write_as_npy_gives_the_bytes_of_numpy() -> None:
    buffer = io.BytesIO()
    np.save(buffer, TWO)
    assert file_of(POINT_FORMATS["npy"], TWO) == buffer.getvalue()


def test_write_as_xyz_gives_these_bytes() -> None:
    assert file_of(POINT_FORMATS["xyz"], TWO) == b"0.5 -1 0\n0.1 2e-07 -123457\n"


@pytest.mark.parametrize("chunk", [1, 2])
def test_write_as_json_gives_these_bytes(chunk: int) -> None:
    expected = b'{"n":2,"points":[[0.5,-1,0],[0.100000001,2.00000002e-07,-123456.789]]}\n'
    assert file_of(POINT_FORMATS["json"], TWO, chunk) == expected


def test_write_as_glb_gives_these_bytes() -> None:
    data = file_of(POINT_FORMATS["glb"], TWO)
    magic, version, length, json_length, kind = struct.unpack_from("<4sIII4s", data)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    document = json.loads(data[20 : 20 + json_length])
    binary = data[20 + json_length :]
    assert binary == struct.pack("<I4s", 24, b"BIN\0") + struct.pack("<6f", *TWO.ravel())
    assert document["meshes"][0]["primitives"][0]["mode"] == 0  # POINTS
    assert document["materials"][0]["extensions"] == {"KHR_materials_unlit": {}}
    accessor = document["accessors"][0]
    assert accessor["count"] == 2
    np.testing.assert_array_equal(np.float32(accessor["min"]), TWO.min(axis=0))
    np.testing.assert_array_equal(np.float32(accessor["max"]), TWO.max(axis=0))


def test_write_as_gltf_gives_the_document_of_glb() -> None:
    data = file_of(POINT_FORMATS["gltf"], TWO)
    uri = json.loads(data)["buffers"][0]["uri"]
    assert base64.b64decode(uri.removeprefix("data:application/octet-stream;base64,")) == struct.pack(
        "<6f", *TWO.ravel()
    )
    glb = file_of(POINT_FORMATS["glb"], TWO)
    document, inside = json.loads(data), json.loads(glb[20 : 20 + 1024])
    del document["buffers"][0]["uri"]
    assert document == inside


def test_write_as_pcd_gives_these_bytes() -> None:
    header = (
        b"# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
        b"WIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA binary\n"
    )
    assert file_of(POINT_FORMATS["pcd"], TWO) == header + struct.pack("<6f", *TWO.ravel())


def test_write_as_f32_and_f16_gives_these_bytes() -> None:
    assert file_of(POINT_FORMATS["f32"], TWO) == struct.pack("<6f", *TWO.ravel())
    assert file_of(POINT_FORMATS["f16"], TWO[:1]) == struct.pack("<3e", *TWO[0])
    assert file_of(POINT_FORMATS["f16"], TWO)[-2:] == struct.pack("<e", -65504)  # saturates, never infinite


# What every format does


@pytest.mark.parametrize("fmt", FORMATS, ids=lambda fmt: fmt.name)
@pytest.mark.parametrize("n", [1, 2, 2500])
def test_write_in_any_format_gives_other_programs_the_points(fmt: PointFormat, n: int) -> None:
    points = canonical_points("ball", n)
    back = read(fmt, file_of(fmt, points))
    if fmt.name in ("xyz", "f16"):  # six digits; eleven bits
        np.testing.assert_allclose(back, points, rtol=5e-6 if fmt.name == "xyz" else 2**-11, atol=1e-7)
    else:
        np.testing.assert_array_equal(back, points)


@pytest.mark.parametrize("fmt", EVERY, ids=label)
def test_write_in_any_chunking_gives_the_same_bytes(fmt: PointFormat) -> None:
    points = canonical_points("ball", 1234)
    assert file_of(fmt, points, 1) == file_of(fmt, points, 100) == file_of(fmt, points, 5000)


@pytest.mark.parametrize("fmt", BINARY, ids=label)
@pytest.mark.parametrize("n", [1, 9, 10, 9999, 10_000])
def test_length_of_a_binary_format_is_that_of_the_file(fmt: PointFormat, n: int) -> None:
    assert fmt.length(n) == len(file_of(fmt, np.ones((n, 3), np.float32)))


@pytest.mark.parametrize("fmt", TEXT, ids=label)
def test_length_of_a_text_format_is_none(fmt: PointFormat) -> None:
    assert fmt.length(1000) is None


@pytest.mark.parametrize("fmt", EVERY, ids=label)
def test_write_of_views_and_either_byte_order_gives_the_same_bytes(fmt: PointFormat) -> None:
    wide = np.arange(40, dtype=np.float32).reshape(10, 4)
    view = wide[::2, :3]
    expected = file_of(fmt, np.ascontiguousarray(view))
    assert file_of(fmt, view) == expected
    assert file_of(fmt, view.astype(">f4")) == expected


@pytest.mark.parametrize("fmt", EVERY, ids=label)
def test_write_gives_one_piece_per_chunk_and_none_empty(fmt: PointFormat) -> None:
    pieces = list(write(fmt, ArrayCloud(np.zeros((500, 3), np.float32), colors_of(500), chunk=100)))
    assert all(pieces)
    assert 5 * len(fmt.passes) <= len(pieces) <= 5 * len(fmt.passes) + 2


@pytest.mark.parametrize("fmt", EVERY, ids=label)
def test_write_takes_a_second_pass_only_for_bounds(fmt: PointFormat) -> None:
    passes = []

    class Counting(ArrayCloud):
        def parts(self) -> Iterator[Part]:
            passes.append(1)
            return super().parts()

    list(write(fmt, Counting(TWO, colors_of(2))))
    assert len(passes) == len(fmt.passes) + fmt.needs_bounds
    assert len(fmt.passes) == (2 if fmt is colored("json") else 1)
    assert fmt.needs_bounds == (fmt.name in ("glb", "gltf"))


@pytest.mark.parametrize("fmt", EVERY, ids=label)
def test_write_of_too_many_or_no_points_raises_at_once(fmt: PointFormat) -> None:
    sizes = [0] if fmt.max_points is None else [0, fmt.max_points + 1]
    for n in sizes:
        with pytest.raises(InvalidParameter) as caught:
            write(fmt, ArrayCloud(np.broadcast_to(np.float32(0), (n, 3))))
        assert caught.value.field == "n"


def test_max_points_of_json_and_glb_are_these() -> None:
    assert POINT_FORMATS["json"].max_points == 100_000
    largest = POINT_FORMATS["glb"].max_points
    assert largest is not None
    length = POINT_FORMATS["glb"].length(largest)
    assert length is not None
    assert 2**32 - 12 <= length < 2**32  # the header holds it in 32 bits


# glTF against the Khronos validator


@pytest.mark.parametrize("n", [1, 2, 10_000])
@pytest.mark.parametrize("name", ["glb", "gltf"])
@pytest.mark.parametrize("in_color", [False, True])
def test_write_as_gltf_passes_the_khronos_validator(name: str, n: int, in_color: bool, tmp_path: Path) -> None:
    points = canonical_points("ball", n, seed=5)
    report = check_valid(file_of(colored(name) if in_color else POINT_FORMATS[name], points), tmp_path)
    assert report["info"]["totalVertexCount"] == n
    assert report["info"]["extensionsUsed"] == ["KHR_materials_unlit"]


@pytest.mark.parametrize("value", [0.0, -0.0, 1.1754944e-38, -3.4028235e38, 1 / 3])
def test_write_as_glb_of_extreme_numbers_passes_the_khronos_validator(value: float, tmp_path: Path) -> None:
    check_valid(file_of(POINT_FORMATS["glb"], np.full((3, 3), value, np.float32)), tmp_path)


@pytest.mark.parametrize("fmt", [POINT_FORMATS["glb"], POINT_FORMATS["glb"].colored], ids=label)
def test_glb_head_of_any_bounds_has_a_fixed_size(fmt: PointFormat) -> None:
    assert fmt.max_points is not None
    long = np.full(3, -1.17549435e-38, np.float32)
    assert len(fmt.head(fmt.max_points, (long, long))) == len(fmt.head(1, bounds([TWO])))


def test_glb_head_without_bounds_raises_value_error() -> None:
    with pytest.raises(ValueError, match="bounds"):
        POINT_FORMATS["glb"].head(2, None)


def test_khronos_validator_of_wrong_bounds_reports_errors(tmp_path: Path) -> None:
    fmt = POINT_FORMATS["glb"]
    wrong = fmt.head(2, (np.zeros(3, np.float32), np.ones(3, np.float32))) + float32(TWO)
    assert gltf_report(wrong, tmp_path)["issues"]["numErrors"] > 0
