"""Build a data set: names, splits, failures, duplicates, second runs."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from model.data.build import build
from model.data.manifest import Manifest
from model.data.rendering.preview import preview
from model.data.sources.meshes import folder_records
from tests.support.small.shapes import SHAPES, write_folder


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
