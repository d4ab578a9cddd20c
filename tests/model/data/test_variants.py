"""Free cameras and stretched shapes of a built data set."""

import math
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image, ImageFilter

from model import cli
from model.data import variants
from model.data.build import build
from model.data.manifest import SIZE, Manifest, texture_files, variant_file, variant_files
from model.data.rendering.render import FILL, shoot, stage
from model.data.sources.meshes import MeshRecord, folder_records, load_parts
from model.data.variants import (
    STRETCHED,
    WARPED,
    VariantsJob,
    render_variants,
    scaled_points,
    stretch_factors,
    vary,
)
from model.data.warp import STRETCH, warp
from service.drawing.cloud import camera_axes
from tests.support.small.shapes import write_folder

CELLS = SIZE // 2  # along a side: 10,000 points reach most of them
VIEWS = 3
OBJECTS = 6  # 4 of the training split, one of each other


@pytest.fixture(scope="module")
def meshes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_folder(tmp_path_factory.mktemp("vary") / "meshes")


@pytest.fixture(scope="module")
def records(meshes: Path) -> list[MeshRecord]:
    return list(folder_records(meshes, "CC0"))[:OBJECTS]


@pytest.fixture(scope="module")
def data(records: list[MeshRecord], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("varied")
    build(records, folder, seed=0, processes=1)
    assert vary(records, folder, variants=2, views=VIEWS, processes=1) == {}
    return folder


def test_vary_all_splits_stretches_training_objects_only(data: Path) -> None:
    for entry in Manifest.read(data).entries:
        files = variant_files(data, entry)
        assert len(files) == (3 if entry.split == "train" else 1)
        stretches = [np.load(file)["stretch"] for file in files]
        assert stretches[0].tolist() == [1, 1, 1]
        assert len({tuple(stretch) for stretch in stretches}) == len(files)
    assert len(list((data / "variants").iterdir())) == 3 * 4 + 2


def test_vary_variant_0_has_the_objects_points_and_other_cameras(data: Path) -> None:
    for entry in Manifest.read(data).entries:
        with np.load(data / entry.file) as base, np.load(variant_files(data, entry)[0]) as free:
            assert (base["points"] == free["points"]).all()
            assert free["views"].shape == (VIEWS, SIZE, SIZE, 4)
            assert (free["cameras"][:, 3] != 0).all() == (entry.split == "train")  # roll


def test_vary_points_lie_where_the_views_show_the_object(data: Path) -> None:
    for entry in Manifest.read(data).entries:
        for file in variant_files(data, entry):
            with np.load(file) as arrays:
                points = arrays["points"]
                assert np.ptp(points, axis=0).max() == pytest.approx(1, abs=0.01)
                assert points.min(axis=0) + points.max(axis=0) == pytest.approx(np.zeros(3), abs=0.01)
                for view, camera in zip(arrays["views"], arrays["cameras"], strict=True):
                    rows, columns = _pixels(points, *camera.tolist())
                    solid = view[..., 3] > 0
                    near = np.asarray(Image.fromarray(solid).convert("L").filter(ImageFilter.MaxFilter(3))) > 0
                    assert near[rows, columns].all()  # all points within a pixel of the object,
                    covered = np.zeros((CELLS, CELLS), bool)
                    covered[rows // 2, columns // 2] = True
                    cells = np.asarray(Image.fromarray(solid).resize((CELLS, CELLS), Image.Resampling.NEAREST))
                    assert covered[cells].mean() > 0.6  # and all of the object under points


def _pixels(
    points: np.ndarray, azimuth: float, elevation: float, distance: float, roll: float
) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns where a pinhole camera sees points."""
    toward, right, up = camera_axes(azimuth, elevation)
    cos, sin = math.cos(math.radians(roll)), math.sin(math.radians(roll))
    depth = distance - points @ toward
    x, y = points @ (cos * right - sin * up) / depth, points @ (cos * up + sin * right) / depth
    half = max(np.abs(x).max(), np.abs(y).max()) / FILL
    return ((1 - y / half) * SIZE / 2).astype(int), ((1 + x / half) * SIZE / 2).astype(int)


def test_shoot_roll_turns_the_image_against_the_camera(tmp_path: Path) -> None:
    trimesh.creation.box(extents=(1, 0.1, 0.1)).export(tmp_path / "bar.ply")
    (record,) = folder_records(tmp_path)
    parts = load_parts(record)
    points = scaled_points(parts, np.ones(3), np.random.default_rng(0))
    with closing(stage(parts)) as plotter:
        (view,) = shoot(plotter, np.array([[0, 0, 5, 20.0]]), points, np.random.default_rng(0))
    rows, columns = np.nonzero(view[..., 3])
    slope = np.polyfit(columns, -rows, 1)[0]
    assert math.degrees(math.atan(slope)) == pytest.approx(20, abs=1)  # a level bar rises to the right


def test_vary_second_run_adds_equal_copies_of_missing_variants_only(data: Path, records: list[MeshRecord]) -> None:
    train = next(iter(Manifest.read(data).of("train")))
    lost = variant_file(data, train, 1)
    with np.load(lost) as arrays:
        first = dict(arrays)
    lost.unlink()
    written = {path: path.stat().st_mtime_ns for path in (data / "variants").iterdir()}
    assert vary(records, data, variants=2, views=VIEWS, processes=1) == {}
    assert {path: path.stat().st_mtime_ns for path in written} == written
    with np.load(lost) as again:
        assert all((again[key] == value).all() for key, value in first.items())


def test_vary_broken_mesh_is_reported_and_left_out(tmp_path: Path) -> None:
    meshes = write_folder(tmp_path / "meshes")
    records = list(folder_records(meshes, "CC0"))[:2]
    folder = tmp_path / "data"
    manifest = build(records, folder, seed=0, processes=1)
    kept, broken = manifest.entries
    path = next(record.path for record in records if record.id == broken.id)
    path.write_text("this is no mesh any more")
    assert list(vary(records, folder, variants=1, views=1, processes=1)) == [broken.id]
    with pytest.raises(FileNotFoundError, match="hof-model data vary"):
        variant_files(folder, broken)
    assert len(variant_files(folder, kept)) == 2
    path.unlink()
    with pytest.raises(ValueError, match=f"lacks 1 objects of the manifest, {broken.id}"):
        vary(folder_records(meshes, "CC0"), folder, variants=1, views=1, processes=1)


def test_stretch_factors_any_seed_keeps_the_longest_side_at_1() -> None:
    parts = [trimesh.creation.box(extents=(1, 0.5, 0.25))]
    for seed in range(50):
        factors = stretch_factors(parts, np.random.default_rng(seed))
        assert (factors * [1, 0.5, 0.25]).max() == pytest.approx(1)
        assert factors.max() / factors.min() <= math.exp(2 * STRETCH)


def test_scaled_points_flat_box_are_uniform_on_the_scaled_surface() -> None:
    box = trimesh.creation.box(extents=(1, 1, 1))
    points = scaled_points([box], np.array([1, 1, 0.1]), np.random.default_rng(0))
    on_top = np.isclose(np.abs(points[:, 2]), 0.05, atol=1e-4).mean()
    assert on_top == pytest.approx(2 / 2.4, abs=0.02)  # 2 of 6 if the box's own faces had been sampled alike


def test_command_vary_and_preview_write_variants_and_a_sheet(data: Path, meshes: Path, tmp_path: Path) -> None:
    assert cli.main(["data", "vary", "--data", str(data), "--meshes", str(meshes), "--variants", "2"]) == 0
    sheet = tmp_path / "sheet.png"
    assert cli.main(["data", "preview", "--data", str(data), "--variants", "--objects", "2", "-o", str(sheet)]) == 0
    with Image.open(sheet) as image:
        assert image.height >= 2 * 142


def test_warp_symmetric_box_stays_in_the_object_frame_and_symmetric() -> None:
    box = trimesh.creation.box(extents=(1, 0.6, 0.4)).subdivide()
    rng = np.random.default_rng(0)
    shapes = [warp([box], rng)[0].vertices for _ in range(20)]
    for vertices in shapes:
        assert np.ptp(vertices, axis=0).max() == pytest.approx(1)
        assert vertices.min(axis=0) + vertices.max(axis=0) == pytest.approx(np.zeros(3), abs=1e-9)
        mirrored = {tuple(point) for point in np.round(vertices * [-1, 1, 1], 6) + 0.0}
        assert mirrored == {tuple(point) for point in np.round(vertices, 6) + 0.0}
    tops = [np.ptp(vertices[vertices[:, 1] == vertices[:, 1].max(), 0]) for vertices in shapes]
    assert min(tops) < 0.8 < max(tops)  # they taper


def test_vary_above_stretched_is_warped(records: list[MeshRecord], tmp_path: Path) -> None:
    build(records, tmp_path, seed=0, processes=1)
    assert vary(records, tmp_path, variants=STRETCHED + 1, views=1, processes=1) == {}
    entry = next(iter(Manifest.read(tmp_path).of("train")))
    *_, last = variant_files(tmp_path, entry)
    with np.load(last) as arrays, np.load(tmp_path / entry.file) as base:
        assert arrays["stretch"].tolist() == [1, 1, 1]
        assert not np.allclose(np.ptp(arrays["points"], axis=0), np.ptp(base["points"], axis=0), atol=0.02)


def test_vary_above_warped_without_textures_raises(records: list[MeshRecord], tmp_path: Path) -> None:
    build(records, tmp_path, seed=0, processes=1)
    with pytest.raises(FileNotFoundError, match="holds no textures: run `hof-model data textures` first"):
        vary(records, tmp_path, WARPED + 1, views=1, processes=1)


def test_render_variants_above_warped_have_other_textures(
    records: list[MeshRecord], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    build(records, tmp_path, seed=0, processes=1)
    entry = next(iter(Manifest.read(tmp_path).of("train")))
    record = next(record for record in records if record.id == entry.id)
    (tmp_path / "textures").mkdir()
    checks = np.kron(np.indices((8, 8)).sum(axis=0) % 2, np.full((8, 8), 255)).astype(np.uint8)
    Image.fromarray(checks).convert("RGB").save(tmp_path / "textures/checks.jpg")
    numbers = range(WARPED, WARPED + 7)
    written, differences = [], []
    for name in ("textured", "plain"):
        (tmp_path / name).mkdir()
        targets = {number: tmp_path / name / f"{number}.npz" for number in numbers}
        render_variants(VariantsJob(record, tmp_path / entry.file, targets, True, texture_files(tmp_path), 1, seed=0))
        monkeypatch.setattr(variants, "redress", lambda *_: None)
        written.append([dict(np.load(target)) for target in targets.values()])
    for textured, plain in zip(*written, strict=True):
        assert (plain["points"] == textured["points"]).all()
        assert (plain["views"][..., 3] == textured["views"][..., 3]).all()
        differences.append(float(np.abs(plain["views"].astype(float) - textured["views"]).mean()))
    assert differences.pop(0) == 0
    assert np.mean([difference > 5 for difference in differences]) > 0.3
