"""Meshes as people have them: one real build over a folder of them, in worker processes."""

import base64
import json
import os
import struct
from pathlib import Path
from typing import Final

import numpy as np
import pytest
import trimesh

from model import cli
from model.data.manifest import Manifest
from tests.support.small import meshes as small

pytestmark = pytest.mark.system  # OpenGL

LONG: Final = "long" * 60  # 240 bytes; with the folders' names more than a file name may have
LATIN: Final = b"caf\xe9.ply"  # no UTF-8
TEXTURES: Final = {
    "plain": r"wood.png",
    "backslash": r"textures\wood.png",
    "drive": r"C:\Users\me\Desktop\textures\wood.png",
    "case": "Textures/WOOD.PNG",
    "options": "-s 1 1 1 -o 0.5 0 -bm 0.2 -clamp on wood.png",
    "quoted": '"textures/wood.png"',
    "elsewhere": "wood.png",
}


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Manifest]:
    """Build all difficult meshes at once; return the data set's folder and manifest."""
    root = tmp_path_factory.mktemp("difficult") / "m"
    for name in ("colors", "polygons", "textures", "names", "gltf"):
        (root / name).mkdir(parents=True)
    _write_colors(root / "colors")
    _write_polygons(root / "polygons")
    _write_textures(root / "textures")
    (root / "names" / LONG).mkdir()
    small.box(19).export(root / "names" / LONG / f"{LONG}.ply")
    small.box(20).export(root / "names" / "x.ply")
    os.rename(os.fsencode(root / "names" / "x.ply"), os.fsencode(root / "names") + b"/" + LATIN)
    _write_gltf(root / "gltf")
    out = root.parent / "data"
    assert cli.main(["data", "build", "--meshes", str(root), "--out", str(out), "--processes", "2"]) == 0
    return out, Manifest.read(out)


def _write_colors(folder: Path) -> None:
    solid = small.box(0)
    solid.visual.vertex_colors = small.halves(solid.vertices)
    solid.export(folder / "ply_vertices.ply")
    solid = small.box(1)
    solid.visual.face_colors = small.halves(solid.triangles_center)
    solid.export(folder / "ply_faces.ply", encoding="ascii")
    for number, name in enumerate(("obj", "obj_material"), 2):
        solid = small.box(number)
        lines = ["mtllib gray.mtl", "usemtl gray"] if name == "obj_material" else []
        for (x, y, z), (red, _, blue, _) in zip(solid.vertices, small.halves(solid.vertices) / 255, strict=True):
            lines.append(f"v {x} {y} {z} {red} 0 {blue}")
        lines += ["f " + " ".join(str(corner + 1) for corner in face) for face in solid.faces]
        (folder / f"{name}.obj").write_text("\n".join(lines) + "\n")
    (folder / "gray.mtl").write_text("newmtl gray\nKd 0.8 0.8 0.8\n")
    for number, material in enumerate((None, {"pbrMetallicRoughness": {"roughnessFactor": 1}}), 4):
        colors = small.halves(small.box(number).vertices)[:, :3] / 255
        name = "gltf_material" if material else "gltf"
        small.write_gltf(folder / f"{name}.gltf", number, colors=colors, material=material)


def _write_polygons(folder: Path) -> None:
    for name, height in (("obj", 0.3), ("ply", 0.5), ("off", 0.7)):
        corners = small.corner_shape(height)
        positions = [f"{x} {y} {z}" for x, y, z in corners]
        sides = [[corner - 1 for corner in side] for side in small.L_SIDES]
        counted = [f"{len(side)} " + " ".join(map(str, side)) for side in sides]
        header = {
            "obj": [],
            "off": ["OFF", f"{len(corners)} {len(sides)} 0"],
            "ply": [
                *("ply", "format ascii 1.0", f"element vertex {len(corners)}"),
                *(f"property float {axis}" for axis in "xyz"),
                *(f"element face {len(sides)}", "property list uchar int vertex_indices", "end_header"),
            ],
        }[name]
        lines = [*header, *positions, *counted]
        if name == "obj":
            lines = [f"v {each}" for each in positions]
            lines += ["f " + " ".join(map(str, side)) for side in small.L_SIDES]
        (folder / f"{name}.{name}").write_text("\n".join(lines) + "\n")


def _write_textures(folder: Path) -> None:
    for number, (name, texture) in enumerate(TEXTURES.items(), 6):
        small.write_textured(folder / name / "mesh" / "box.obj", number, texture)
        place = {"elsewhere": "images", "plain": "mesh", "options": "mesh"}.get(name, "mesh/textures")
        small.write_image(folder / name / place / "wood.png")
    small.write_textured(folder / "missing" / "box.obj", 13, "oak.png")
    small.write_textured(folder / "broken" / "box.obj", 14, "burnt.png")
    (folder / "broken" / "burnt.png").write_bytes(b"\x89PNG\r\n\x1a\n broken")
    small.write_textured(folder / "library" / "box.obj", 15, "", library="nowhere.mtl")


def _write_gltf(folder: Path) -> None:
    small.write_gltf(folder / "linear.gltf", 16, material={"pbrMetallicRoughness": {"baseColorFactor": [0.2, 0, 0, 1]}})
    gloss = {"diffuseFactor": [0, 0.2, 0, 1], "specularFactor": [0, 0, 0]}
    material = {"extensions": {"KHR_materials_pbrSpecularGlossiness": gloss}}
    required = ["KHR_materials_pbrSpecularGlossiness"]
    small.write_gltf(folder / "gloss.gltf", 17, material=material, extensionsRequired=required)
    small.write_gltf(folder / "percent.gltf", 18)
    header = json.loads((folder / "percent.gltf").read_text())
    (folder / "my mesh.bin").write_bytes(_buffer(header["buffers"][0]["uri"]))
    header["buffers"][0]["uri"] = "my%20mesh.bin"
    (folder / "percent.gltf").write_text(json.dumps(header))
    for name, extension in (
        ("quantized", "KHR_mesh_quantization"),
        ("meshopt", "EXT_meshopt_compression"),
        ("unknown", "ACME_shape"),
    ):
        small.write_gltf(folder / f"{name}.gltf", 18, extensionsRequired=[extension], extensionsUsed=[extension])
    accessor = {"componentType": 5126, "count": 3, "type": "VEC3"}
    primitive = {"attributes": {"POSITION": 0}, "extensions": {"ACME_points": {}}}
    header = {"asset": {"version": "2.0"}, "meshes": [{"primitives": [primitive]}], "accessors": [accessor]}
    text = json.dumps(header).encode().ljust(400)
    (folder / "zeros.glb").write_bytes(struct.pack("<4sIIII", b"glTF", 2, 20 + len(text), len(text), 0x4E4F534A) + text)


def _buffer(uri: str) -> bytes:
    return base64.b64decode(uri.split(",")[1])


def _arrays(built: tuple[Path, Manifest], id_: str) -> dict[str, np.ndarray]:
    folder, manifest = built
    entry = next(entry for entry in manifest.entries if entry.id == id_)
    with np.load(folder / entry.file) as arrays:
        return dict(arrays)


@pytest.mark.parametrize("name", ["ply_vertices", "ply_faces", "obj", "obj_material", "gltf", "gltf_material"])
def test_build_colored_vertices_or_faces_color_points_and_views(built: tuple[Path, Manifest], name: str) -> None:
    arrays = _arrays(built, f"m/colors/{name}")
    x = arrays["points"][:, 0]
    assert (arrays["colours"][x < -0.15] == (255, 0, 0)).all()
    assert (arrays["colours"][x > 0.15] == (0, 0, 255)).all()
    front = arrays["views"][0].astype(int)
    side = front.shape[1] // 2
    for half, strong, weak in ((front[:, : side - 20], 0, 2), (front[:, side + 20 :], 2, 0)):
        opaque = half[half[..., 3] > 250]
        assert len(opaque) > 100
        assert (opaque[:, strong] > opaque[:, weak] + 50).mean() > 0.95


@pytest.mark.parametrize("name", ["obj", "ply", "off"])
def test_build_concave_polygon_leaves_its_gap_free(built: tuple[Path, Manifest], name: str) -> None:
    points = _arrays(built, f"m/polygons/{name}")["points"]
    across, along = points[:, 0] * 2 + 1, points[:, 2] * 2 + 1  # back to L_SHAPE's units
    assert not ((across > 0.51) & (along > 0.51)).any()
    area = ((across > 0.51) | (along > 0.51)).mean()
    assert area > 0.5  # both arms are there


@pytest.mark.parametrize("name", list(TEXTURES))
def test_build_texture_under_another_name_is_found(built: tuple[Path, Manifest], name: str) -> None:
    id_ = f"m/textures/{name}/mesh/box"
    assert (_arrays(built, id_)["colours"] == small.BROWN).all()
    assert id_ not in built[1].losses


@pytest.mark.parametrize(
    ("name", "loss"),
    [
        ("missing", "oak.png is missing"),
        ("broken", "burnt.png cannot be read"),
        ("library", "nowhere.mtl is missing"),
    ],
)
def test_build_lost_texture_is_reported_by_name(built: tuple[Path, Manifest], name: str, loss: str) -> None:
    assert loss in built[1].losses[f"m/textures/{name}/box"]
    assert len(_arrays(built, f"m/textures/{name}/box")["points"]) == 10_000


def test_build_long_and_undecodable_names_are_kept(built: tuple[Path, Manifest]) -> None:
    ids = {entry.id: entry for entry in built[1].entries}
    assert ids["m/names/caf%E9"].name == "caf%E9"
    long = ids[f"m/names/{LONG}/{LONG}"]
    assert len(Path(long.file).name.encode()) < 220
    assert _arrays(built, long.id)["points"].shape == (10_000, 3)


def test_build_base_color_factor_is_encoded_to_srgb(built: tuple[Path, Manifest]) -> None:
    assert (_arrays(built, "m/gltf/linear")["colours"] == (124, 0, 0)).all()  # 0.2 is 0.485 in sRGB


def test_build_specular_glossiness_has_its_diffuse_color(built: tuple[Path, Manifest]) -> None:
    color = _arrays(built, "m/gltf/gloss")["colours"][0].astype(int)
    assert color[1] == pytest.approx(124, abs=4)
    assert color[[0, 2]].max() < 10


def test_build_percent_encoded_buffer_is_found(built: tuple[Path, Manifest]) -> None:
    extents = np.ptp(_arrays(built, "m/gltf/percent")["points"], axis=0)
    assert extents == pytest.approx([1, 0.15 + 0.04 * 18, 0.4], abs=0.01)


@pytest.mark.parametrize(
    ("name", "extension"),
    [
        ("quantized", "KHR_mesh_quantization"),
        ("meshopt", "EXT_meshopt_compression"),
        ("unknown", "ACME_shape"),
        ("zeros", "ACME_points"),
    ],
)
def test_build_unread_extension_is_refused_by_name(built: tuple[Path, Manifest], name: str, extension: str) -> None:
    assert f"the file needs {extension}, which is not read" in built[1].failures[f"m/gltf/{name}"]


def test_build_difficult_meshes_fails_for_unread_extensions_alone(built: tuple[Path, Manifest]) -> None:
    assert {Path(id_).name for id_ in built[1].failures} == {"quantized", "meshopt", "unknown", "zeros"}
    assert built[1].duplicates == {}


def test_build_z_up_in_millimeters_stands_upright(tmp_path: Path) -> None:
    (tmp_path / "m").mkdir()
    lamp = trimesh.creation.cone(radius=200, height=1000)  # along Z, its tip above
    lamp.export(tmp_path / "m" / "lamp.stl")
    out = tmp_path / "data"
    command = ["data", "build", "--meshes", str(tmp_path / "m"), "--out", str(out), "--up", "z", "--split", "train"]
    assert cli.main([*command, "--processes", "1"]) == 0
    (entry,) = Manifest.read(out).entries
    with np.load(out / entry.file) as arrays:
        points = arrays["points"]
    assert np.ptp(points, axis=0) == pytest.approx([0.4, 1, 0.4], abs=0.02)
    assert np.abs(points[points[:, 1] > 0.4][:, [0, 2]]).max() < 0.05
    assert entry.split == "train"
    assert entry.rotation == (1, 0, 0, 0, 0, 1, 0, -1, 0)
