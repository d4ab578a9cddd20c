"""Mesh sources: the Sweet Home 3D catalog, any folder, and the object frame."""

import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from model.cli.common import ROOT, SHIPPED
from model.data.sources.meshes import MeshRecord, folder_records, load_parts
from model.data.sources.photographs import FOLDER, photograph_files
from model.data.sources.sweethome3d import CATALOG, frozen_split, parse_catalog, sh3f_files, sh3f_records
from model.evaluation.locations import RESULTS
from model.evaluation.records import Record
from service.encoding.encoder import Encoder
from tests.support.small.shapes import SHAPES, write_folder

PROPERTIES = """# comment
id=SweetHome3D#Test
name=Test library
license=Creative Commons Attribution 3.0 license  \u00a9 Someone

id#2=Test#lamp
name#2=Caf\\u00e9 lamp
category#2=Lights
model#2=/test/lamp/lamp.obj
modelRotation#2=1 0 0 0 0 1 0 -1 0
creator#2=Zo\u00eb
name#10=Not a model
name#1=Box
category#1=Living room
model#1=/test/box/box.obj
"""


@pytest.fixture
def library(tmp_path: Path) -> Path:
    path = tmp_path / "libraries" / "Test.sh3f"
    path.parent.mkdir()
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(CATALOG, PROPERTIES.encode("latin-1"))
        archive.writestr("test/box/box.obj", "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 4\nf 1 2 3\nf 1 3 4\n")
        archive.writestr("test/lamp/lamp.obj", "v 0 0 0\nv 1 0 0\nv 1 0 3\nf 1 2 3\n")
    return path


def test_sh3f_records_library_yields_models_in_order_with_metadata(library: Path, tmp_path: Path) -> None:
    box, lamp = sh3f_records(library, tmp_path / "work")
    assert (box.id, box.name, box.category) == ("Test/box", "Box", "Living room")
    assert box.license == "Creative Commons Attribution 3.0 license © Someone"
    assert box.creator == "Test library"
    assert (lamp.name, lamp.creator) == ("Café lamp", "Zoë")
    assert box.path.is_file()
    assert lamp.path.is_file()


def test_parse_catalog_entry_without_model_is_left_out() -> None:
    general, entries = parse_catalog(PROPERTIES)
    assert general["name"] == "Test library"
    assert [entry["name"] for entry in entries] == ["Box", "Café lamp"]


def test_load_parts_model_rotation_turns_the_mesh_upright(library: Path, tmp_path: Path) -> None:
    _, lamp = sh3f_records(library, tmp_path / "work")
    (part,) = load_parts(lamp)
    # the catalog's matrix takes (x, y, z) to (x, z, -y): what was 3 deep is 3 high
    assert np.ptp(part.vertices, axis=0) == pytest.approx([1 / 3, 1, 0])


def test_sh3f_files_folder_or_file_is_accepted_and_empty_folder_refused(library: Path, tmp_path: Path) -> None:
    assert sh3f_files(library.parent, tmp_path) == [library]
    assert sh3f_files(library, tmp_path) == [library]
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(FileNotFoundError, match=r"no \.sh3f file"):
        sh3f_files(empty, tmp_path)


def test_frozen_split_shipped_figures_are_of_its_objects() -> None:
    frozen = frozen_split()
    sizes = [list(frozen.values()).count(split) for split in ("train", "val", "test")]
    card = Encoder.open(SHIPPED, threads=1).card["data"]["objects"]
    assert sizes == [card[split] for split in ("train", "val", "test")]
    record = Record.read(ROOT / RESULTS / "hof1-k2.json")
    assert set(record.ids) == {id_ for id_, split in frozen.items() if split == "test"}


def test_sh3f_files_broken_deb_names_the_failed_command(tmp_path: Path) -> None:
    broken = tmp_path / "broken.deb"
    broken.write_bytes(b"no archive")
    with pytest.raises(FileNotFoundError, match="dpkg-deb"):
        sh3f_files(broken, tmp_path / "work")


def test_folder_records_folder_yields_every_mesh_in_the_object_frame(tmp_path: Path) -> None:
    records = list(folder_records(write_folder(tmp_path / "meshes"), license_="CC0"))
    assert len(records) == SHAPES
    assert {record.category for record in records} == {"boxes", "round"}
    assert {record.license for record in records} == {"CC0"}
    for record in records:
        corners = np.concatenate([part.vertices for part in load_parts(record)])
        low, high = corners.min(axis=0), corners.max(axis=0)
        assert (high - low).max() == pytest.approx(1)
        assert low + high == pytest.approx(np.zeros(3), abs=1e-9)


def test_folder_records_missing_folder_raises(tmp_path: Path) -> None:
    with pytest.raises(NotADirectoryError):
        list(folder_records(tmp_path / "nowhere"))


@pytest.mark.parametrize(
    ("text", "message"),
    [("v 0 0 0\nv 1 0 0\n", "no triangles"), ("v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n", "empty or not finite")],
)
def test_load_parts_unusable_mesh_raises(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.obj"
    path.write_text(text)
    record = MeshRecord("t/bad", path, "t", "bad", "c", "x", "CC0")
    with pytest.raises(ValueError, match=message):
        load_parts(record)


def test_load_parts_scene_transforms_are_applied(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box(), transform=trimesh.transformations.translation_matrix([0, 0, 3]))
    scene.add_geometry(trimesh.creation.box())
    scene.export(tmp_path / "two.glb")
    (record,) = folder_records(tmp_path)
    corners = np.concatenate([part.vertices for part in load_parts(record)])
    assert np.ptp(corners, axis=0) == pytest.approx([0.25, 0.25, 1])


def test_photograph_files_bundled_and_downloaded_are_listed(tmp_path: Path) -> None:
    bundled = photograph_files(tmp_path)
    (tmp_path / FOLDER).mkdir()
    Image.new("RGB", (8, 8)).save(tmp_path / FOLDER / "wall.jpg")
    assert photograph_files(tmp_path) == (*bundled, tmp_path / FOLDER / "wall.jpg")
    for path in bundled:
        with Image.open(path) as photograph:
            assert min(photograph.size) >= 100
