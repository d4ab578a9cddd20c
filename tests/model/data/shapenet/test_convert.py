"""ShapeNet's layouts: what is read from small files in the true layout, and what is said about missing ones."""

from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from model.data.manifest import Manifest
from model.data.shapenet.clouds import read_cloud, surface_of
from model.data.shapenet.convert import DENSE, FOLDER, convert
from model.data.shapenet.layouts import LAYOUTS, PTN, R2N2, WHAT3D
from tests.support.small import data as boxes
from tests.support.small import shapenet

SIDES = np.array([4, 8, 16]) / 32


@pytest.fixture(scope="module")
def ptn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return convert(PTN, shapenet.write_ptn(tmp_path_factory.mktemp("ptn")))


def test_ptn_has_the_splits_of_its_lists_and_the_classes_of_shapenet(ptn: Path) -> None:
    entries = Manifest.read(ptn).entries
    assert {entry.id.rpartition("/")[2]: entry.split for entry in entries} == {
        **dict.fromkeys("abc", "train"),
        "d": "val",
        **dict.fromkeys("ef", "test"),
    }
    assert {(entry.category, entry.source) for entry in entries} == {("chair", PTN)}


def test_ptn_views_are_in_order_of_azimuth_and_clouds_centered_at_their_scale(ptn: Path) -> None:
    entry = next(entry for entry in Manifest.read(ptn).entries if entry.id.endswith("e"))
    with np.load(ptn / entry.file) as arrays:
        assert arrays["views"].shape == (24, 64, 64, 4)
        assert arrays["cameras"][:3].tolist() == [[0, 30], [15, 30], [30, 30]]
        assert arrays["points"].shape == (10_000, 3)
        assert arrays[DENSE].shape == (12_000, 3)
        drawn, dense = arrays["views"], arrays[DENSE]
    assert np.ptp(dense, axis=0).max() == pytest.approx(0.8, abs=1e-3)
    assert np.abs(dense.max(axis=0) + dense.min(axis=0)).max() < 1e-6
    true = 0.8 * boxes.box(4, 12_000)
    np.testing.assert_allclose(dense, true * [-1, 1, -1], atol=2e-3)
    front = np.abs(drawn[0, ..., :3].astype(int) - np.array(shapenet.picture(boxes.views(true + 0.07, 1)[0], "RGB")))
    assert front.mean() < 12  # JPEG
    with np.load(ptn / next(entry.file for entry in Manifest.read(ptn).entries if entry.split == "train")) as arrays:
        assert DENSE not in arrays


def test_ptn_without_clouds_takes_the_voxels(tmp_path: Path) -> None:
    folder = convert(PTN, shapenet.write_ptn(tmp_path, clouds=False))
    with np.load(folder / Manifest.read(folder).entries[0].file) as arrays:
        np.testing.assert_allclose(np.ptp(arrays["points"], axis=0), SIDES, atol=1e-6)


def test_r2n2_has_portions_of_the_sorted_names_cameras_and_voxels(tmp_path: Path) -> None:
    folder = convert(R2N2, shapenet.write_r2n2(tmp_path))
    entries = Manifest.read(folder).entries
    splits = {entry.id.rpartition("/")[2]: entry.split for entry in entries}
    assert splits == {**{f"m{n:02d}": "train" for n in range(7)}, "m07": "val", "m08": "test", "m09": "test"}
    with np.load(folder / entries[0].file) as arrays:
        assert arrays["views"].shape == (24, 64, 64, 4)
        assert set(np.unique(arrays["views"][..., 3])) == {0, 255}
        assert arrays["cameras"][2].tolist() == [30.0, 27.5]
        np.testing.assert_allclose(np.ptp(arrays["points"], axis=0), 0.5 * SIDES, atol=1e-6)


@pytest.mark.parametrize("validation", [True, False])
def test_what3d_has_an_entry_for_each_view(validation: bool, tmp_path: Path) -> None:
    folder = convert(WHAT3D, shapenet.write_what3d(tmp_path, validation))
    entries = Manifest.read(folder).entries
    expected = {"train": 10, "val": 5, "test": 5} if validation else {"train": 5, "val": 5, "test": 5}
    assert Counter(entry.split for entry in entries) == expected
    entry = next(entry for entry in entries if entry.id == "chair/a/3")
    with np.load(folder / entry.file) as arrays:
        assert arrays["views"].shape == (1, 64, 64, 4)
        distances = np.abs(arrays["points"][:, None, :] - boxes.box(3, 2_000)[None, :50]).sum(axis=2).min(axis=0)
    assert np.median(distances) < 0.01  # the camera's frame is not turned


@pytest.mark.parametrize("kind", list(LAYOUTS))
def test_missing_folder_names_the_file_and_the_layout(kind: str, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=f"{tmp_path}.* is missing; this layout is expected:\n") as caught:
        convert(kind, tmp_path)
    assert "CLASS" in str(caught.value)


def test_missing_list_is_named(tmp_path: Path) -> None:
    shapenet.write_ptn(tmp_path)
    (tmp_path / "shapenetcore_ids" / f"{shapenet.CLASS}_testids.txt").unlink()
    with pytest.raises(FileNotFoundError, match=r"testids\.txt is missing"):
        convert(PTN, tmp_path)


def test_broken_model_is_a_failure_and_the_second_run_takes_what_is_there(tmp_path: Path) -> None:
    shapenet.write_what3d(tmp_path)
    (tmp_path / "points" / "chair" / "a" / "0.ply").write_text("no ply")
    (tmp_path / "points" / "chair" / "a" / "1.ply").unlink()
    manifest = Manifest.read(convert(WHAT3D, tmp_path))
    assert len(manifest.entries) == 18
    assert set(manifest.failures) == {"chair/a/0", "chair/a/1"}
    assert "1.ply is missing" in manifest.failures["chair/a/1"]
    before = (tmp_path / FOLDER / "manifest.json").stat().st_mtime_ns
    assert convert(WHAT3D, tmp_path) == tmp_path / FOLDER
    assert (tmp_path / FOLDER / "manifest.json").stat().st_mtime_ns == before


def test_voxels_become_points_on_their_outer_faces() -> None:
    grid = np.zeros((4, 4, 4), bool)
    grid[1:3, 1:3, 1:3] = True
    points = surface_of(grid)
    assert points.min() == 0.25
    assert points.max() == 0.75
    on_a_face = (np.abs(points - 0.5) == 0.25).any(axis=1)
    assert on_a_face.all()
    np.testing.assert_allclose(points.mean(axis=0), 0.5, atol=0.01)


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("a.binvox", b"#binvox 1\ndim 32 32 32\ntranslate 0 0 0\nscale 1\ndata\n\x01\x05"),
        ("b.binvox", b"ply"),
        ("c.mat", b"MATLAB"),
        ("d.obj", b""),
    ],
)
def test_damaged_file_of_points_raises_value_error_with_its_name(name: str, data: bytes, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(data)
    with pytest.raises(ValueError, match=name):
        read_cloud(path)
