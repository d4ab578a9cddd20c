"""PLY: concave faces with textures and colors, and names of colors."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from model.data.rendering.surface import face_colors, material_image, vertex_colors
from model.data.sources.formats.assets import Assets
from model.data.sources.formats.ply import read_ply
from tests.support.small.meshes import BROWN, L_SHAPE, write_image

FACES = ((2, 3, 4, 5, 0, 1), (3, 4, 5, 0, 1, 2))  # fans from their first corners cover the gap


def read(folder: Path, vertex: str, face: str, vertices: list[str], faces: list[str]) -> trimesh.Trimesh:
    """Write an ASCII file with these properties and rows, and read it."""
    lines = ["ply", "format ascii 1.0", "comment TextureFile wood.png", f"element vertex {len(vertices)}"]
    lines += [f"property {name}" for name in ("float x", "float y", "float z", *filter(None, vertex.split(",")))]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    lines += [f"property {name}" for name in filter(None, face.split(","))]
    text = "\n".join([*lines, "end_header", *vertices, *faces, ""])
    (part,) = read_ply(text.encode(), Assets(folder / "m.ply", folder))
    return part


def corners(*extra: str) -> list[str]:
    """Return the rows of L_SHAPE's corners, with the same further values each, or its texture coordinates."""
    return [" ".join([f"{x} 0 {y}", *(extra or (f"{x / 2} {y / 2}",))]) for x, y in L_SHAPE]


@pytest.mark.parametrize("by_face", [False, True])
def test_read_ply_concave_face_keeps_its_texture(tmp_path: Path, by_face: bool) -> None:
    write_image(tmp_path / "wood.png")
    rows = [f"{len(face)} " + " ".join(map(str, face)) for face in FACES]
    if by_face:
        places = [" ".join(f"{L_SHAPE[n][0] / 2} {L_SHAPE[n][1] / 2}" for n in face) for face in FACES]
        rows = [f"{row} {2 * int(row[0])} {place}" for row, place in zip(rows, places, strict=True)]
        part = read(tmp_path, "", "list uchar float texcoord", corners(""), rows)
    else:
        part = read(tmp_path, "float s,float t", "", corners(), rows)
    assert part.area == pytest.approx(1.75 * 2)
    image = material_image(part)
    assert image is not None
    assert image.getpixel((0, 0)) == BROWN
    assert np.asarray(part.visual.uv) == pytest.approx(np.asarray(part.vertices)[:, [0, 2]] / 2)


def test_read_ply_concave_face_keeps_its_color(tmp_path: Path) -> None:
    rows = ["6 2 3 4 5 0 1 255 0 0", "3 0 1 2 0 0 255"]
    part = read(tmp_path, "", "uchar red,uchar green,uchar blue", corners(""), rows)
    colors = face_colors(part)
    assert colors is not None
    assert colors.tolist() == [[255, 0, 0]] * 4 + [[0, 0, 255]]


@pytest.mark.parametrize("names", ["diffuse_red,diffuse_green,diffuse_blue", "r,g,b"])
def test_read_ply_colors_of_other_names_are_read(tmp_path: Path, names: str) -> None:
    properties = ",".join(f"uchar {name}" for name in names.split(","))
    vertices = ["0 0 0 255 0 0", "1 0 0 0 255 0", "0 0 1 0 0 255"]
    colors = vertex_colors(read(tmp_path, properties, "", vertices, ["3 0 1 2"]))
    assert colors is not None
    assert colors.tolist() == [[255, 0, 0], [0, 255, 0], [0, 0, 255]]
