"""Rendering, deduplication, splits, and building a data set."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from model.data.build import build
from model.data.dedupe import duplicates
from model.data.manifest import SIZE, Manifest, assign_splits
from model.data.rendering.cameras import RING_VIEWS
from model.data.rendering.preview import preview
from model.data.rendering.render import render
from model.data.rendering.surface import sample_surface
from model.data.sources.meshes import MeshRecord, folder_records
from service.drawing.cloud import camera_axes
from tests.support.small.shapes import SHAPES, write_folder


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


def test_render_two_colored_box_shows_the_right_side_in_the_right_color(half_red_box: MeshRecord) -> None:
    rendered = render(half_red_box, seed=0)
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
    first, again, other = (render(half_red_box, seed) for seed in (0, 0, 1))
    assert (first.views == again.views).all()
    assert (first.points == again.points).all()
    assert (first.cameras[:, 1] != other.cameras[:, 1]).all()
    assert (first.views[0] != first.views[3]).any()


def test_render_points_lie_on_the_surface_with_its_colors(half_red_box: MeshRecord) -> None:
    rendered = render(half_red_box, seed=0)
    x = rendered.points[:, 0]
    assert np.abs(rendered.points).max(axis=0) == pytest.approx([0.5, 0.25, 0.25], abs=1e-6)
    red = rendered.colors[:, 0] > 128
    assert (red[x > 0.01]).all()
    assert not red[x < -0.01].any()


def test_sample_surface_two_boxes_follows_area() -> None:
    big, small = trimesh.creation.box(extents=(1, 1, 1)), trimesh.creation.box(extents=(0.5, 0.5, 0.5))
    small.apply_translation((3, 0, 0))
    points, _ = sample_surface([big, small], 20_000, np.random.default_rng(0))
    assert (points[:, 0] > 2).mean() == pytest.approx(0.2, abs=0.01)


def test_render_texture_colors_points_as_views(tmp_path: Path) -> None:
    texture = Image.new("RGB", (64, 64), (0, 0, 255))
    texture.paste((255, 0, 0), (0, 0, 32, 64))  # the left half is red,
    texture.paste((0, 255, 0), (0, 0, 64, 16))  # the upper quarter green
    quad = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], process=False)
    quad.visual = trimesh.visual.TextureVisuals(uv=[[0, 0], [1, 0], [1, 1], [0, 1]], image=texture)
    quad.export(tmp_path / "quad.obj")
    rendered = render(MeshRecord("t/quad", tmp_path / "quad.obj", "t", "quad", "c", "x", "CC0"), seed=0)
    x, y, _ = rendered.points.T
    wanted = np.where(y > 0.25, 1, np.where(x < 0, 0, 2))
    inside = (np.abs(y - 0.25) > 0.02) & (np.abs(x) > 0.02)
    assert (rendered.colors.argmax(axis=1) == wanted)[inside].all()
    front = rendered.views[0][..., :3].argmax(axis=2)
    assert [front[14, 64], front[100, 30], front[100, 98]] == [1, 0, 2]


def test_camera_axes_any_angle_is_a_right_handed_frame() -> None:
    toward, right, up = camera_axes(0, 0)
    assert toward.tolist() == [0, 0, 1]
    assert right.tolist() == [1, 0, 0]
    assert up.tolist() == [0, 1, 0]
    toward, right, up = camera_axes(77, 31)
    assert np.stack([right, up, toward]) @ np.stack([right, up, toward]).T == pytest.approx(np.eye(3), abs=1e-6)


def test_duplicates_turned_and_mirrored_copies_are_mapped_but_not_look_alikes() -> None:
    rng = np.random.default_rng(0)
    shape = trimesh.util.concatenate(
        [
            trimesh.creation.box(extents=(1, 0.2, 0.6)),
            trimesh.creation.box(
                extents=(0.2, 0.5, 0.1), transform=trimesh.transformations.translation_matrix([0.3, 0.3, 0.1])
            ),
        ]
    )
    other = trimesh.creation.box(extents=(1, 0.2, 0.6))

    def cloud(mesh: trimesh.Trimesh) -> np.ndarray:
        return sample_surface([mesh], 10_000, rng)[0]

    turned = cloud(shape)[:, [2, 1, 0]] * np.array([1, 1, -1], np.float32)
    mirrored = cloud(shape) * np.array([-1, 1, 1], np.float32)
    clouds = {"a": cloud(shape), "b": turned, "c": mirrored, "d": cloud(other), "e": cloud(shape)}
    assert duplicates(clouds) == {"b": "a", "c": "a", "e": "a"}


def test_assign_splits_by_seed_gives_disjoint_splits_of_the_right_sizes() -> None:
    ids = [f"object {index}" for index in range(200)]
    splits = assign_splits(ids, seed=3)
    sizes = {split: list(splits.values()).count(split) for split in ("train", "val", "test")}
    assert sizes == {"train": 160, "val": 20, "test": 20}
    assert splits == assign_splits(ids[::-1], seed=3)
    assert splits != assign_splits(ids, seed=4)


def test_assign_splits_fixed_ids_keep_their_split() -> None:
    before = assign_splits([f"object {index}" for index in range(100)], seed=0)
    splits = assign_splits([f"object {index}" for index in range(3, 150)], seed=0, fixed=before)
    assert {id_: split for id_, split in splits.items() if id_ in before} == {
        id_: split for id_, split in before.items() if id_ in splits
    }
    fresh = [split for id_, split in splits.items() if id_ not in before]
    assert {split: fresh.count(split) for split in ("train", "val", "test")} == {"train": 40, "val": 5, "test": 5}


def test_build_grown_folder_keeps_splits_and_seed(tmp_path: Path) -> None:
    meshes, out = write_folder(tmp_path / "meshes"), tmp_path / "data"
    extra = next(path for path in sorted(meshes.rglob("*.*")) if path.name == "shape01.ply")
    waiting = extra.rename(tmp_path / "shape01.ply")
    first = build(folder_records(meshes), out, seed=0, processes=2, frozen={"meshes/round/shape00": "test"})
    waiting.rename(extra)
    grown = build(folder_records(meshes), out, seed=0, processes=2)
    before, after = ({entry.id: entry.split for entry in each.entries} for each in (first, grown))
    assert before["meshes/round/shape00"] == "test"
    assert len(after) == len(before) + 1
    assert after.items() >= before.items()
    with pytest.raises(ValueError, match="was built with seed 0: build with seed 1 in another folder"):
        build(folder_records(meshes), out, seed=1, processes=1)


def test_build_meshes_of_one_name_raises(tmp_path: Path) -> None:
    for name in ("chair.obj", "chair.ply"):
        trimesh.creation.box().export(tmp_path / name)
    with pytest.raises(ValueError, match=r"have one name, .*__chair: rename one of them"):
        build(folder_records(tmp_path), tmp_path / "data", seed=0, processes=1)


def test_build_bad_mesh_and_copy_are_reported_and_a_second_run_resumes(tmp_path: Path) -> None:
    meshes = write_folder(tmp_path / "meshes")
    (meshes / "round" / "broken.obj").write_text("this is no mesh")
    (meshes / "round" / "zcopy.ply").write_bytes((meshes / "boxes" / "shape01.ply").read_bytes())
    out = tmp_path / "data"
    manifest = build(folder_records(meshes, "CC0"), out, seed=0, processes=2)
    assert list(manifest.failures) == ["meshes/round/broken"]
    assert manifest.duplicates == {"meshes/round/zcopy": "meshes/boxes/shape01"}
    assert len(manifest.entries) == SHAPES
    assert Manifest.read(out) == manifest
    assert len({entry.mesh_sha256 for entry in manifest.entries}) == SHAPES
    written = {path: path.stat().st_mtime_ns for path in (out / "objects").iterdir()}
    assert build(folder_records(meshes, "CC0"), out, seed=0, processes=1) == manifest
    assert {path: path.stat().st_mtime_ns for path in (out / "objects").iterdir()} == written
    preview(out, tmp_path / "sheet.png", objects=3)
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.size == (6 * 128, 3 * (128 + 14))
        assert np.asarray(sheet.convert("L")).min() < 128


def test_manifest_missing_names_the_command_to_run(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="hof-model data build"):
        Manifest.read(tmp_path)


def _redder(pixels: np.ndarray) -> float:
    """Share of the opaque pixels that are more red than blue."""
    opaque = pixels[pixels[..., 3] > 250]
    return float((opaque[:, 0] > opaque[:, 2]).mean())
