"""Files of points and meshes, read again as written here and elsewhere, and refused where they are faulty."""

import io
import json
import struct
import tracemalloc
from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt
import pytest
import trimesh

from service.errors import CorruptPoints, HofError, TooLarge, UnsupportedMedia
from service.formats.glb import glb_head
from service.formats.scans import limits, read
from service.formats.scans.read import SAMPLES, kind_of, read_points
from tests.support.small.data import box

Floats = npt.NDArray[np.float32]

POINTS = box(3)[:100]
TEXT = "\n".join(" ".join(map(str, point)) for point in POINTS.tolist())
BOX = trimesh.creation.box((1, 2, 3))


def _npy(array: npt.NDArray[np.generic]) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def _ply(encoding: str = "ascii") -> bytes:
    cloud = trimesh.PointCloud(POINTS, colors=np.full((100, 4), 7, np.uint8))
    exported: bytes | str = cloud.export(file_type="ply", encoding=encoding)
    return exported if isinstance(exported, bytes) else exported.encode()


def _pcd(data: str, body: bytes) -> bytes:
    head = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS rgb x y z\nSIZE 4 4 4 4\nTYPE U F F F\n"
        "COUNT 1 1 1 1\nWIDTH 100\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 100\n"
    )
    return f"{head}DATA {data}\n".encode() + body


RECORDS = np.zeros(100, [("rgb", "<u4"), ("xyz", "<f4", 3)])
RECORDS["xyz"] = POINTS
BIG_ENDIAN = (
    b"ply\nformat binary_big_endian 1.0\nelement vertex 100\nproperty double x\nproperty double y\nproperty uchar a\n"
    b"property double z\nelement face 0\nproperty list uchar int vertex_indices\nend_header\n"
    + np.rec.fromarrays([POINTS[:, 0], POINTS[:, 1], np.zeros(100), POINTS[:, 2]], formats=">f8,>f8,u1,>f8").tobytes()
)
CLOUDS = {
    "xyz": TEXT.encode(),
    "xyz, with a comment and colors": ("# x y z r g b\n" + TEXT.replace("\n", " 1 2 3\r\n") + " 1 2 3").encode(),
    "xyz, commas": TEXT.replace(" ", ", ").encode(),
    "npy": _npy(POINTS),
    "npy, doubles in columns": _npy(np.asfortranarray(POINTS.astype(np.float64))),
    "npy, with colors": _npy(np.hstack([POINTS, POINTS])),
    "ply": _ply(),
    "ply, binary": _ply("binary"),
    "ply, big-endian with faces": BIG_ENDIAN,
    "pcd": _pcd("ascii", "\n".join(f"0 {line}" for line in TEXT.splitlines()).encode()),
    "pcd, binary": _pcd("binary", RECORDS.tobytes()),
}


@pytest.mark.parametrize("data", CLOUDS.values(), ids=CLOUDS)
def test_read_points_of_a_cloud_gives_its_points(data: bytes) -> None:
    np.testing.assert_allclose(read_points(data), POINTS, atol=1e-6)


MESHES: dict[str, Callable[[], bytes | str]] = {
    "glb": lambda: BOX.export(file_type="glb"),
    "obj": lambda: BOX.export(file_type="obj"),
    "stl": lambda: BOX.export(file_type="stl"),
    "stl, text": lambda: BOX.export(file_type="stl_ascii"),
}


@pytest.mark.parametrize("export", MESHES.values(), ids=MESHES)
def test_read_points_of_a_mesh_covers_its_surface(export: Callable[[], bytes | str]) -> None:
    exported = export()
    data = exported if isinstance(exported, bytes) else exported.encode()
    points = read_points(data)
    assert points.shape == (SAMPLES, 3)
    np.testing.assert_array_equal(points, read_points(data))
    sides = np.array([1, 2, 3]) / 2
    on_face = np.isclose(np.abs(points), sides, atol=1e-6)
    assert on_face.any(axis=1).all()
    assert (np.abs(points) <= sides + 1e-6).all()
    areas = np.array([6, 3, 2]) / 11  # of the faces across x, y and z
    np.testing.assert_allclose(on_face.mean(axis=0), areas, atol=0.02)


def test_read_points_of_a_glb_follows_its_nodes() -> None:
    scene = trimesh.Scene()
    turned = trimesh.transformations.compose_matrix(scale=(2, 1, 1), angles=(0, 0, np.pi / 2), translate=(5, 0, 0))
    scene.add_geometry(BOX, transform=turned)
    points = read_points(scene.export(file_type="glb"))
    np.testing.assert_allclose([points.min(0), points.max(0)], [[4, -1, -1.5], [6, 1, 1.5]], atol=0.05)


def _glb(document: Mapping[str, object], numbers: bytes = bytes(36)) -> bytes:
    return glb_head(json.dumps(document).encode(), len(numbers)) + numbers


ACCESSOR: dict[str, object] = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}
SCENE: dict[str, object] = {
    "asset": {"version": "2.0"},
    "scenes": [{"nodes": [0]}],
    "nodes": [{"mesh": 0}],
    "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
    "accessors": [ACCESSOR],
    "bufferViews": [{"buffer": 0, "byteLength": 36}],
    "buffers": [{"byteLength": 36}],
}
STL_TRIANGLE = struct.pack("<80sI", b"", 1) + bytes(50)
FAULTY: dict[str, tuple[bytes, type[HofError]]] = {
    "nothing": (b"", UnsupportedMedia),
    "another text": (b"hello", UnsupportedMedia),
    "a photo": (b"\x89PNG\r\n\x1a\n" + bytes(100), UnsupportedMedia),
    "a line without numbers": (b"1 2 3\n4 five 6\n", CorruptPoints),
    "a short line": (b"1 2 3\n4 5\n", CorruptPoints),
    "infinity": (b"1 2 3\n1e39 0 0\n", CorruptPoints),
    "npy of objects": (_npy(np.array([[1, 2, 3]], dtype="U1")), CorruptPoints),
    "npy that is cut": (_npy(POINTS)[:-1], CorruptPoints),
    "npy of two columns": (_npy(POINTS[:, :2]), CorruptPoints),
    "npy that claims more": (_npy(POINTS).replace(b"(100, 3)", b"(9**9,3)"), CorruptPoints),
    "npy of NaN": (_npy(np.full((100, 3), np.nan)), CorruptPoints),
    "ply that is cut": (BIG_ENDIAN[:-1], CorruptPoints),
    "ply that claims more": (_ply("binary").replace(b"vertex 100", b"vertex 99999999"), CorruptPoints),
    "ply without x": (_ply().replace(b"float x", b"float u"), CorruptPoints),
    "ply without an end": (b"ply\nformat ascii 1.0\n", CorruptPoints),
    "ply of a list": (_ply().replace(b"property float x", b"property list uchar int x"), CorruptPoints),
    "pcd that is cut": (CLOUDS["pcd, binary"][:-1], CorruptPoints),
    "pcd, compressed": (_pcd("binary_compressed", bytes(100)), UnsupportedMedia),
    "pcd without x": (CLOUDS["pcd"].replace(b"rgb x", b"rgb u"), CorruptPoints),
    "pcd of an odd size": (CLOUDS["pcd"].replace(b"SIZE 4", b"SIZE 3"), CorruptPoints),
    "obj with a missing vertex": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", CorruptPoints),
    "obj with vertex 0": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", CorruptPoints),
    "obj with a faulty face": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 x\n", CorruptPoints),
    "obj without faces": (b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", CorruptPoints),
    "stl without area": (STL_TRIANGLE, CorruptPoints),
    "glb that is cut": (b"glTF\x02\0\0\0", CorruptPoints),
    "glb without area": (_glb(SCENE), CorruptPoints),
    "glb beyond its numbers": (_glb(SCENE | {"accessors": [ACCESSOR | {"count": 10**12}]}), CorruptPoints),
    "glb before its numbers": (_glb(SCENE | {"accessors": [ACCESSOR | {"byteOffset": -4}]}), CorruptPoints),
    "glb of fractions": (_glb(SCENE | {"accessors": [ACCESSOR | {"count": 1.5}]}), CorruptPoints),
    "glb with draco": (_glb(SCENE | {"extensionsRequired": ["KHR_draco_mesh_compression"]}), UnsupportedMedia),
    "glb in circles": (_glb(SCENE | {"nodes": [{"children": [0, 0]}]}), TooLarge),
    "glb with an unknown node": (_glb(SCENE | {"scenes": [{"nodes": [7]}]}), CorruptPoints),
    "glb of a list": (glb_head(b"[]  ", 0), CorruptPoints),
}


@pytest.mark.parametrize(("data", "error"), FAULTY.values(), ids=FAULTY)
def test_read_points_of_a_faulty_file_raises(data: bytes, error: type[HofError]) -> None:
    with pytest.raises(error) as raised:
        read_points(data)
    assert type(raised.value) is error
    assert raised.value.field == "points"


def test_read_points_of_too_many_points_or_triangles_raises(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(read, "MAX_POINTS", 99)
    with pytest.raises(TooLarge, match="100 points, the limit is 99"):
        read_points(CLOUDS["npy"])
    monkeypatch.setattr(read, "MAX_TRIANGLES", 11)
    with pytest.raises(TooLarge, match="12 triangles, the limit is 11"):
        read_points(BOX.export(file_type="stl"))
    assert limits.MAX_POINTS > 10**6


def test_read_points_of_a_glb_whose_primitives_share_numbers_is_refused_before_they_unfold() -> None:
    count, primitives = 99_999, 300  # 1.2 MB of numbers, 10 million triangles
    document = SCENE | {
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}] * primitives}],
        "accessors": [ACCESSOR | {"count": count}],
    }
    data = _glb(document, bytes(12 * count))
    tracemalloc.start()
    try:
        with pytest.raises(TooLarge, match="more than 2000000 triangles"):
            read_points(data)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 1.1 * limits.MAX_TRIANGLES * 9 * 8  # bytes of the triangles below the limit


@pytest.mark.parametrize("head", [b"\n", b"  ", b"# written by hand\n"])
def test_read_points_of_an_ascii_stl_after_blanks_or_a_comment_reads_it(head: bytes) -> None:
    text = BOX.export(file_type="stl_ascii")
    data = text if isinstance(text, bytes) else text.encode()
    np.testing.assert_array_equal(read_points(head + data), read_points(data))


@pytest.mark.parametrize("data", [b"", b"abc", b"GIF89a", b"\xff\xd8\xff" + bytes(200), b"RIFF....WEBP"])
def test_kind_of_other_files_is_none(data: bytes) -> None:
    assert kind_of(data) is None
