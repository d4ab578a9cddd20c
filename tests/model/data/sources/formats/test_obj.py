"""OBJ: where a texture lies, which colors count, and polygons."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from model.data.rendering.surface import material_color, vertex_colors
from model.data.sources.formats.assets import Assets
from model.data.sources.formats.obj import divide_concave, read_obj
from tests.support.small.meshes import write_image

ARROW = "v 0 0 0\nv 1 0 0\nv 0.2 0.2 0\nv 0 1 0\n"


def read(folder: Path, text: str) -> trimesh.Trimesh:
    (part,) = read_obj(text.encode(), Assets(folder / "m.obj", folder))
    return part


def test_read_obj_texture_options_place_the_texture(tmp_path: Path) -> None:
    write_image(tmp_path / "wood.png")
    (tmp_path / "m.mtl").write_text("newmtl wood\nmap_Kd -s 2 4 1 -o 0.5 wood.png\n")
    text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.25 0.5\nusemtl wood\nf 1/1 2/1 3/1\n"
    assert np.asarray(read(tmp_path, text).visual.uv)[0] == pytest.approx([1, 2])


def test_read_obj_white_vertices_leave_the_material_its_color(tmp_path: Path) -> None:
    (tmp_path / "m.mtl").write_text("newmtl red\nKd 1 0 0\n")
    text = "mtllib m.mtl\nusemtl red\nv 0 0 0 1 1 1\nv 1 0 0 1 1 1\nv 0 1 0 1 1 1\nf 1 2 3\n"
    part = read(tmp_path, text)
    assert vertex_colors(part) is None
    assert material_color(part)[0].tolist() == [255, 0, 0]


@pytest.mark.parametrize("scale", [1, 255])
def test_read_obj_vertices_with_texture_coordinates_alone_show_their_colors(tmp_path: Path, scale: int) -> None:
    text = f"v 0 0 0 {scale} 0 0\nv 1 0 0 0 {scale} 0\nv 0 1 0 0 0 {scale}\nvt 0 0\nf 1/1 2/1 3/1\n"
    colors = vertex_colors(read(tmp_path, text))
    assert colors is not None
    assert sorted(colors.tolist()) == [[0, 0, 255], [0, 255, 0], [255, 0, 0]]


@pytest.mark.parametrize("face", ["f 2/1/1 3/2/1 4/3/1 1/4/1", "f -3/1/1 -2/2/1 -1/3/1 -4/4/1"])
def test_divide_concave_quad_keeps_references(face: str) -> None:
    first, second, *rest = [line for line in divide_concave(ARROW + face).split("\n") if line.startswith("f")]
    assert not rest
    references = face.split()[1:]
    assert set(first.split()[1:]) | set(second.split()[1:]) == set(references)
    assert {references[1], references[3]} <= set(first.split()) & set(second.split())  # along the diagonal inside


def test_divide_concave_convex_polygons_leaves_the_text_alone() -> None:
    text = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4 # square\nf 1 2 3\n"
    assert divide_concave(text) == text


def test_divide_concave_vertex_that_is_not_there_is_named() -> None:
    with pytest.raises(ValueError, match="'f 1 2 3 9' names a vertex that is not there: the file has 4"):
        divide_concave(ARROW + "f 1 2 3 9")
