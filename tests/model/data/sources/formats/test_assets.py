"""Files that meshes name: where they are found, and where not."""

from pathlib import Path

import pytest

from model.data.sources.formats.assets import Assets, split_options
from tests.support.small.meshes import write_image


@pytest.mark.parametrize(
    ("name", "file", "options"),
    [
        ("wood.png", "wood.png", {}),
        ("-s 2 3 1 my wood.png", "my wood.png", {"s": (2, 3, 1)}),
        ("-o 0.5 -blendu on -mm 0 1 1.png", "1.png", {"o": (0.5,)}),
        ("-bm 0.3 -clamp off -imfchan r -type sphere 'a b.png'", "a b.png", {}),
    ],
)
def test_split_options_texture_of_mtl_gives_name_and_placement(
    name: str, file: str, options: dict[str, tuple[float, ...]]
) -> None:
    assert split_options(name) == (file, options)


def test_find_texture_prefers_the_nearest_folder(tmp_path: Path) -> None:
    for place in ("wood.png", "a/textures/wood.png", "b/wood.png"):
        write_image(tmp_path / place)
    assert Assets(tmp_path / "a/mesh.obj", tmp_path).find("WOOD.png") == tmp_path / "a/textures/wood.png"
    assert Assets(tmp_path / "c/mesh.obj", tmp_path).find("b\\wood.png") == tmp_path / "b/wood.png"


def test_find_several_files_of_other_meshes_takes_none(tmp_path: Path) -> None:
    for place in ("a/wood.png", "b/wood.png"):
        write_image(tmp_path / place)
    (tmp_path / "c").mkdir()
    assert Assets(tmp_path / "c/mesh.obj", tmp_path).find("wood.png") is None


def test_find_buffer_of_another_mesh_is_not_taken(tmp_path: Path) -> None:
    for place in ("a/deep/scene.bin", "a/Scene.bin"):
        (tmp_path / place).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / place).write_bytes(b"")
    assert Assets(tmp_path / "a/mesh.gltf", tmp_path).find("scene.bin") == tmp_path / "a/Scene.bin"
    assert Assets(tmp_path / "b/mesh.gltf", tmp_path).find("scene.bin") is None


@pytest.mark.parametrize("name", ["../secret.png", "/etc/hostname", "C:\\..\\..\\secret.png", "a\0b.png", "x" * 300])
def test_find_file_outside_of_the_folder_is_not_read(tmp_path: Path, name: str) -> None:
    write_image(tmp_path / "secret.png")
    (tmp_path / "meshes").mkdir()
    assets = Assets(tmp_path / "meshes/mesh.obj", tmp_path / "meshes")
    with pytest.raises(FileNotFoundError):
        assets.get(name)
    assert len(assets.losses) == 1


def test_get_material_file_in_latin_1_is_utf_8(tmp_path: Path) -> None:
    (tmp_path / "m.mtl").write_bytes("map_Kd Größe.png".encode("latin-1"))
    assert Assets(tmp_path / "m.obj", tmp_path)["m.mtl"].decode() == "map_Kd Größe.png"
