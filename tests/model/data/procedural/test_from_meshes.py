"""Pieces of meshes: resumed, near-duplicates left out, drawn as other pieces are."""

import json
from pathlib import Path

import numpy as np
import pytest

from model import cli
from model.config import TrainConfig
from model.data.build import build
from model.data.dataset import load_examples
from model.data.manifest import SIZE, SURFACE_POINTS, Manifest, piece_entries
from model.data.procedural.from_meshes import make_from_meshes
from model.data.sources.meshes import folder_records
from tests.support.small.shapes import solid, write_folder

VIEWS = 2


def test_make_with_meshes_adds_each_shape_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    records = list(folder_records(write_folder(tmp_path / "others"), "CC0"))[:4]
    data, meshes = tmp_path / "set", tmp_path / "meshes"
    build(records, data, seed=0, processes=1)
    meshes.mkdir()
    for name, index in (("a", 1), ("b", 1), ("c", 3)):  # b repeats a
        solid(index).export(meshes / f"{name}.glb")
    (meshes / "manifest.jsonl").write_text(
        "".join(
            json.dumps({"file": f"{name}.glb", "category": "box", "license": "CC0", "author": "Ann"}) + "\n"
            for name in "abc"
        )
    )
    make = ["data", "make", "--data", str(data), "--meshes", str(meshes), "--views", str(VIEWS)]
    assert cli.main([*make, "--processes", "1"]) == 0
    assert "2 pieces of meshes, 1 duplicates, 0 failures" in capsys.readouterr().out
    assert Manifest.read(data / "made").duplicates == {"meshes/b": "meshes/a"}
    assert [(entry.file, entry.split) for entry in piece_entries(data)] == [
        ("made/meshes__a.npz", "train"),
        ("made/meshes__c.npz", "train"),
    ]
    assert cli.main(["data", "notice", "--data", str(data)]) == 0
    assert 'meshes: CC0\n\n    "a" by Ann\n    "c" by Ann\n' in capsys.readouterr().out
    files = sorted((data / "made").glob("*.npz"))
    assert [file.stem for file in files] == ["meshes__a", "meshes__c"]
    for file in files:
        with np.load(file) as arrays:
            assert arrays["views"].shape == (VIEWS, SIZE, SIZE, 4)
            assert arrays["points"].shape == (SURFACE_POINTS, 3)
    (group,) = load_examples(data, "train", TrainConfig().framing, pieces=True).pieces
    assert len(group) == 2

    written = files[0].stat().st_mtime_ns
    files[1].unlink()
    assert cli.main([*make, "--processes", "1"]) == 0
    assert sorted((data / "made").glob("*.npz")) == files
    assert files[0].stat().st_mtime_ns == written


def test_make_with_a_mesh_of_the_test_split_leaves_it_out(tmp_path: Path) -> None:
    records = list(folder_records(write_folder(tmp_path / "others"), "CC0"))[:4]
    build(records, tmp_path / "set", seed=0, processes=1, split="test")
    meshes = tmp_path / "meshes"
    meshes.mkdir()
    for index in (1, 2):
        solid(index).export(meshes / f"{index}.glb")
    manifest = make_from_meshes(folder_records(meshes, "CC0"), tmp_path / "set", VIEWS, processes=1)
    assert manifest.duplicates == {"meshes/1": "others/boxes/shape01"}
    assert [entry.id for entry in manifest.entries] == ["meshes/2"]
    assert not (tmp_path / "set" / "made" / "meshes__1.npz").exists()


def test_make_pieces_and_meshes_at_once_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        cli.main(["data", "make", "--pieces", "3", "--meshes", "folder"])
    assert "not allowed with argument" in capsys.readouterr().err
