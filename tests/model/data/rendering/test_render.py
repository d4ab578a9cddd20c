"""Views and points of rendered meshes."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from model.data.manifest import SIZE
from model.data.rendering.cameras import RING_VIEWS
from model.data.rendering.render import Rendered, render_parts
from model.data.sources.meshes import MeshRecord, load_parts


@pytest.fixture
def half_red_box(tmp_path: Path) -> MeshRecord:
    """Write a box, its +X half red, its -X half blue, by an OBJ material file."""
    (tmp_path / "box.mtl").write_text("newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n")
    lines, count = ["mtllib box.mtl"], 0
    for material, shift in (("red", 0.5), ("blue", -0.5)):
        box = trimesh.creation.box(extents=(1, 1, 1))
        box.apply_translation((shift, 0, 0))
        lines += [f"v {x} {y} {z}" for x, y, z in box.vertices] + [f"usemtl {material}"]
        lines += [f"f {a + count + 1} {b + count + 1} {c + count + 1}" for a, b, c in box.faces]
        count += len(box.vertices)
    path = tmp_path / "box.obj"
    path.write_text("\n".join(lines))
    return MeshRecord("t/box", path, "t", "box", "c", "x", "CC0")


def _render(record: MeshRecord, seed: int) -> Rendered:
    return render_parts(load_parts(record), record.id, seed)


def test_render_two_colored_box_shows_the_right_side_in_the_right_color(half_red_box: MeshRecord) -> None:
    rendered = _render(half_red_box, seed=0)
    assert rendered.views.shape == (RING_VIEWS, SIZE, SIZE, 4)
    assert rendered.cameras[:, 0] == pytest.approx(np.arange(RING_VIEWS) * 15)
    alpha = rendered.views[..., 3]
    assert (alpha.max(axis=(1, 2)) == 255).all()
    assert (alpha[:, 0, :] == 0).all()  # the object never touches the edge
    front, right, back = (rendered.views[index].astype(int) for index in (0, 6, 12))
    assert _redder(front[:, SIZE // 2 + 8 :]) > 0.9  # from the front, +X is on the right
    assert _redder(front[:, : SIZE // 2 - 8]) < 0.1
    assert _redder(back[:, : SIZE // 2 - 8]) > 0.9
    assert _redder(right[SIZE // 2 :]) > 0.9  # azimuth 90 looks at +X; above its face the top is seen


def test_render_equal_seed_repeats_views_that_differ(half_red_box: MeshRecord) -> None:
    first, again, other = (_render(half_red_box, seed) for seed in (0, 0, 1))
    assert (first.views == again.views).all()
    assert (first.points == again.points).all()
    assert (first.cameras[:, 1] != other.cameras[:, 1]).all()
    assert (first.views[0] != first.views[3]).any()


def test_render_points_lie_on_the_surface_with_its_colors(half_red_box: MeshRecord) -> None:
    rendered = _render(half_red_box, seed=0)
    x = rendered.points[:, 0]
    assert np.abs(rendered.points).max(axis=0) == pytest.approx([0.5, 0.25, 0.25], abs=1e-6)
    red = rendered.colors[:, 0] > 128
    assert (red[x > 0.01]).all()
    assert not red[x < -0.01].any()


def test_render_texture_colors_points_as_views(tmp_path: Path) -> None:
    texture = Image.new("RGB", (64, 64), (0, 0, 255))
    texture.paste((255, 0, 0), (0, 0, 32, 64))  # the left half is red,
    texture.paste((0, 255, 0), (0, 0, 64, 16))  # the upper quarter green
    quad = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], process=False)
    quad.visual = trimesh.visual.TextureVisuals(uv=[[0, 0], [1, 0], [1, 1], [0, 1]], image=texture)
    quad.export(tmp_path / "quad.obj")
    rendered = _render(MeshRecord("t/quad", tmp_path / "quad.obj", "t", "quad", "c", "x", "CC0"), seed=0)
    x, y, _ = rendered.points.T
    wanted = np.where(y > 0.25, 1, np.where(x < 0, 0, 2))
    inside = (np.abs(y - 0.25) > 0.02) & (np.abs(x) > 0.02)
    assert (rendered.colors.argmax(axis=1) == wanted)[inside].all()
    front = rendered.views[0][..., :3].argmax(axis=2)
    assert [front[14, 64], front[100, 30], front[100, 98]] == [1, 0, 2]


def _redder(pixels: np.ndarray) -> float:
    """Share of the opaque pixels that are more red than blue."""
    opaque = pixels[pixels[..., 3] > 250]
    return float((opaque[:, 0] > opaque[:, 2]).mean())
