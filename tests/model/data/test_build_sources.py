"""Several sources in one data set, their credits, and folders that can't be built from."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from model import cli
from model.data.manifest import Entry, Manifest
from model.data.notice import notice
from model.data.sources.listed import LIST
from model.data.variants import vary
from tests.support.small.meshes import box
from tests.support.small.shapes import write_folder

pytestmark = pytest.mark.system  # OpenGL


def run(*arguments: str | Path) -> int:
    return cli.main(["data", *map(str, arguments)])


def write_listed(folder: Path, copied: Path) -> Path:
    """Write a folder with a list: a new object, a copy of an object that is already there, and one that is missing."""
    folder.mkdir()
    box(7).export(folder / "a_new.glb")
    (folder / "a_copy.ply").write_bytes(copied.read_bytes())
    rows = [
        {
            "file": "a_new.glb",
            "source": "shop",
            "title": "New",
            "author": "Zoë",
            "license": "CC-BY-4.0",
            "page": "https://x",
        },
        {"file": "a_copy.ply", "source": "shop"},
        {"file": "gone.ply", "source": "shop"},
    ]
    (folder / LIST).write_text("\n".join(map(json.dumps, rows)), encoding="utf-8")
    return folder


def test_build_listed_folder_joins_the_training_split_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    own, out = write_folder(tmp_path / "zoo"), tmp_path / "data"
    assert run("build", "--meshes", own, "--out", out, "--processes", "2") == 0
    before = Manifest.read(out)
    listed = write_listed(tmp_path / "listed", own / "boxes" / "shape01.ply")
    assert run("build", "--meshes", listed, "--out", out, "--processes", "2", "--split", "train") == 0
    joined = Manifest.read(out)
    new = [entry for entry in joined.entries if entry not in before.entries]
    assert set(before.entries) < set(joined.entries)
    assert [(entry.id, entry.split, entry.creator, entry.page) for entry in new] == [
        ("listed/a_new", "train", "Zoë", "https://x")
    ]
    assert joined.duplicates == {"listed/a_copy": "zoo/boxes/shape01"}
    assert list(joined.failures) == ["listed/gone"]
    assert run("build", "--meshes", own, "--out", out, "--processes", "1") == 0
    assert set(Manifest.read(out).entries) == set(joined.entries)
    capsys.readouterr()
    assert run("notice", "--data", out) == 0
    text = capsys.readouterr().out
    assert 'shop: CC-BY-4.0\n\n    "New" by Zoë (https://x)\n' in text
    assert run("notice", "--data", out, "-o", tmp_path / "credits.txt") == 0
    assert (tmp_path / "credits.txt").read_text(encoding="utf-8") == text


def test_vary_one_source_of_several_keeps_its_axes(tmp_path: Path) -> None:
    out = tmp_path / "data"
    for name, up in (("first", "y"), ("second", "z")):
        (tmp_path / name).mkdir()
        trimesh.creation.box(extents=(1, 0.3 if up == "y" else 0.5, 2)).export(tmp_path / name / "box.ply")
        folder = tmp_path / name
        assert run("build", "--meshes", folder, "--out", out, "--up", up, "--split", "train", "--processes", "1") == 0
    meshes = tmp_path / "second"
    assert run("vary", "--data", out, "--meshes", meshes, "--variants", "9", "--views", "1", "--processes", "1") == 0
    files = sorted(path.name for path in (out / "variants").iterdir())
    assert files == [f"second__box__{number}.npz" for number in range(10)]
    with np.load(out / "variants" / "second__box__1.npz") as arrays:
        assert np.ptp(arrays["points"], axis=0)[1] == pytest.approx(1, abs=0.01)  # two high, one wide
    with pytest.raises(ValueError, match="the source lacks 2 objects of the manifest"):
        vary([], out, 1, 1, 1)


def test_notice_entries_are_grouped_by_source_and_license() -> None:
    entries = [
        Entry(f"s/{name}", name, source, "c", creator, license_, "", "", "train", page)
        for name, source, creator, license_, page in (
            ("Vase", "b", "Zoë", "CC-BY-4.0", ""),
            ("Lamp", "b", "unknown", "CC-BY-4.0", "https://lamp"),
            ("Cup", "a", "unknown", "CC0", ""),
            ("Bed", "b", "Ann", "CC-BY-4.0", "https://bed"),
        )
    ]
    assert notice(entries) == (
        'a: CC0\n\n    "Cup", author unknown\n\n'
        'b: CC-BY-4.0\n\n    "Bed" by Ann (https://bed)\n    "Lamp", author unknown (https://lamp)\n    "Vase" by Zoë\n'
    )


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ([], "holds no mesh: put .obj, .glb, .gltf, .ply, .stl, .off files there"),
        (["a.zip", "b.ZIP"], "holds no mesh: 2 .zip are not read, unpack them there"),
        (["a.fbx", "b.7z"], "holds no mesh: 1 .7z is not read, unpack them there; 1 .fbx is not read, convert them"),
    ],
)
def test_build_folder_without_meshes_says_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], files: list[str], message: str
) -> None:
    (tmp_path / "m").mkdir()
    for file in files:
        (tmp_path / "m" / file).touch()
    assert run("build", "--meshes", tmp_path / "m", "--out", tmp_path / "data") == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("m.zip", "m.zip is a file, not a folder: unpack it and pass the folder"),
        ("m.glb", "m.glb is a file, not a folder: pass the folder that holds it"),
        ("nowhere", "nowhere is not there: pass the folder that holds the meshes"),
    ],
)
def test_build_file_instead_of_folder_says_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, message: str
) -> None:
    if name != "nowhere":
        (tmp_path / name).touch()
    assert run("build", "--meshes", tmp_path / name, "--out", tmp_path / "data") == 2
    assert message in capsys.readouterr().err


def test_build_handful_of_meshes_says_which_splits_are_empty(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "m").mkdir()
    box(0).export(tmp_path / "m" / "a.ply")
    (tmp_path / "m" / "more.zip").touch()
    assert run("build", "--meshes", tmp_path / "m", "--out", tmp_path / "data", "--processes", "1") == 0
    text = capsys.readouterr().err
    assert "no objects in val and test: training needs all three splits. Add meshes" in text
    assert "1 .zip is not read, unpack them there" in text


def test_build_broken_meshes_alone_fails_with_the_first_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "m").mkdir()
    (tmp_path / "m" / "a.obj").write_text("nothing")
    assert run("build", "--meshes", tmp_path / "m", "--out", tmp_path / "data", "--processes", "1") == 2
    assert "none of 1 meshes can be used; m/a: " in capsys.readouterr().err
