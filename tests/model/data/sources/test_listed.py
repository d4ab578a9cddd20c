"""Folders with a list of their meshes: what a line may say, and what is wrong with it."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from model.data.sources.axes import Axis
from model.data.sources.listed import LIST, mesh_records
from model.data.sources.meshes import IDENTITY, load_parts, turn


def write(folder: Path, *rows: Any) -> Path:  # noqa: ANN401 - JSON
    """Write a mesh and a list of it."""
    folder.mkdir(exist_ok=True)
    trimesh.creation.box(extents=(1, 2, 4)).export(folder / "box.ply")
    (folder / LIST).write_text("\n".join(json.dumps(row) for row in rows) + "\n", encoding="utf-8")
    return folder


def test_mesh_records_full_line_keeps_license_author_and_page(tmp_path: Path) -> None:
    row = {
        "file": "box.ply",
        "source": "shop",
        "licence": "CC-BY-4.0",
        "title": "Böx",
        "author": "Zoë",
        "page": "https://x",
    }
    (record,) = mesh_records(write(tmp_path / "m", {**row, "parts": 3, "front": None}))
    assert (record.id, record.name, record.source, record.category) == ("m/box", "Böx", "shop", "m")
    assert (record.license, record.creator, record.page) == ("CC-BY-4.0", "Zoë", "https://x")
    assert record.rotation == IDENTITY


def test_mesh_records_short_line_takes_defaults(tmp_path: Path) -> None:
    (record,) = mesh_records(write(tmp_path / "m", {"file": "box.ply"}), license_="CC0", up="z")
    assert (record.name, record.source, record.license, record.creator) == ("box", "m", "CC0", "unknown")
    assert record.rotation == turn("z")


def test_mesh_records_folder_without_list_has_all_meshes(tmp_path: Path) -> None:
    (write(tmp_path / "m") / LIST).unlink()
    (record,) = mesh_records(tmp_path / "m", license_="CC0")
    assert (record.id, record.license) == ("m/box", "CC0")


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ([], "line 2: an object is expected"),
        ({}, "line 2: file None is not the name of a mesh"),
        ({"file": "box.blend"}, "line 2: file 'box.blend' is not the name of a mesh: .obj"),
        ({"file": "../box.ply"}, "is not below .*: move it there"),
        ({"file": "box.ply", "up": "w"}, "'w' is no axis: use one of x, -x"),
        ({"file": "box.ply", "up": "z", "front": "-z"}, "lie on one line: choose another front"),
        ({"file": "box.ply", "author": 7}, "author 7 is not text"),
    ],
)
def test_mesh_records_wrong_line_is_named(tmp_path: Path, row: Any, message: str) -> None:  # noqa: ANN401 - JSON
    with pytest.raises(ValueError, match=message):
        mesh_records(write(tmp_path / "m", {"file": "box.ply"}, row))


@pytest.mark.parametrize(
    ("up", "front", "top", "toward"),
    [
        ("y", None, (0, 1, 0), (0, 0, 1)),
        ("z", None, (0, 0, 1), (0, -1, 0)),
        ("z", "x", (0, 0, 1), (1, 0, 0)),
        ("-y", "-x", (0, -1, 0), (-1, 0, 0)),
        ("x", None, (1, 0, 0), (0, 0, 1)),
    ],
)
def test_turn_axes_go_to_y_and_z(up: Axis, front: Axis | None, top: tuple[int, ...], toward: tuple[int, ...]) -> None:
    rotation = np.array(turn(up, front)).reshape(3, 3)
    assert (rotation @ top).tolist() == [0, 1, 0]
    assert (rotation @ toward).tolist() == [0, 0, 1]
    assert np.linalg.det(rotation) == pytest.approx(1)


def test_load_parts_listed_front_is_turned(tmp_path: Path) -> None:
    (record,) = mesh_records(write(tmp_path / "m", {"file": "box.ply", "front": "x"}))
    (part,) = load_parts(record)
    assert np.ptp(part.vertices, axis=0) == pytest.approx([1, 0.5, 0.25])
