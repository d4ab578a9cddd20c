"""Textures of procedural pieces and redressed objects: their source, and their layout on a part."""

from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from model import cli
from model.data.manifest import Entry, Manifest, Split, texture_files
from model.data.procedural import textures
from model.data.procedural.pieces import piece
from model.data.procedural.textures import SIDES, draw_texture, wrap
from model.data.rendering.render import shoot, stage
from model.data.rendering.surface import material_color, material_image


def noise(side: int, seed: int) -> Image.Image:
    """8 x 8 fields of random colors."""
    fields = np.random.default_rng(seed).integers(0, 255, (8, 8, 3), np.uint8)
    return Image.fromarray(fields).resize((side, side), Image.Resampling.NEAREST)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Objects of the training and the test split, images beside them: each in a folder of its own, and both in one."""
    root = tmp_path_factory.mktemp("textures")
    entries = []
    for seed, split in enumerate[Split](("train", "test")):
        place = root / "meshes" / split
        place.mkdir(parents=True)
        trimesh.creation.box().export(place / "mesh.ply")
        noise(400, seed).save(place / "large.PNG")
        entries.append(Entry(f"meshes/{split}/mesh", "Box", "meshes", split, "", "CC0", "", "", split))
    for index, split in enumerate[Split](("train", "test")):  # in one folder: whose is the image?
        place = root / "meshes" / "both"
        place.mkdir(exist_ok=True)
        trimesh.creation.box().export(place / f"{split}.ply")
        noise(400, 7 + index).save(place / f"{split}.png")
        entries.append(Entry(f"meshes/both/{split}", "Box", "meshes", split, "", "CC0", "", "", split))
    place = root / "meshes/train"
    noise(400, 0).save(place / "the same again.png")
    noise(SIDES[0] - 1, 2).save(place / "small.png")
    Image.new("RGB", (64, 64), (90, 20, 20)).save(place / "even.jpg")
    (place / "broken.jpg").write_bytes(b"\xff\xd8\xff")
    (root / "set").mkdir()
    Manifest(0, tuple(entries), {}, {}).write(root / "set/manifest.json")
    return root / "set"


def test_gather_textures_mixed_splits_keeps_training_images_once_and_small(
    data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for _ in range(2):
        assert cli.main(["data", "textures", "--data", str(data), "--meshes", str(data.parent / "meshes")]) == 0
        assert capsys.readouterr().out == "1 textures\n"
    (kept,) = texture_files(data)
    with Image.open(kept) as image:
        assert image.size == (SIDES[1], SIDES[1])
        pixels = np.asarray(image, float)
    own, other = (np.asarray(noise(SIDES[1], seed), float) for seed in (0, 1))
    assert np.abs(pixels - own).mean() < 10
    assert np.abs(pixels - other).mean() > 50


def test_draw_texture_many_draws_tints_some(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(textures, "PRINT_SHARE", 0)
    path = tmp_path / "green.jpg"
    Image.fromarray(
        np.dstack([np.zeros((8, 8)), np.arange(64).reshape(8, 8) * 3 + 40, np.zeros((8, 8))]).astype(np.uint8)
    ).save(path)
    rng = np.random.default_rng(0)
    means = [np.asarray(draw_texture([path], (0.8, 0.1, 0.1), rng)).mean(axis=(0, 1)) for _ in range(40)]
    red = [mean[0] > 2 * mean[1] for mean in means]
    assert 0 < np.mean(red) < 1
    assert all(mean[1] > 2 * mean[0] for mean, is_red in zip(means, red, strict=True) if not is_red)


def test_draw_texture_many_draws_prints_some_in_the_material_color(tmp_path: Path) -> None:
    path = tmp_path / "blue.jpg"
    Image.new("RGB", (8, 8), (0, 0, 255)).save(path)
    rng = np.random.default_rng(0)
    images = [np.asarray(draw_texture([path], (0.9, 0.5, 0.1), rng), int) for _ in range(80)]
    prints = [image for image in images if image.std(axis=(0, 1)).max() > 10]
    assert 0.1 < len(prints) / len(images) < 0.3
    assert all(np.abs(image - (230, 128, 26)).max(axis=2).min() < 90 for image in prints)
    striped = [np.ptp(image, axis=1).max() == 0 or np.ptp(image, axis=0).max() == 0 for image in prints]
    assert 0 < np.mean(striped) < 1


def test_redress_object_keeps_shape_and_changes_look(data: Path) -> None:
    glass = trimesh.visual.material.SimpleMaterial(diffuse=(90, 90, 200, 60))
    parts = [trimesh.graph.smooth_shade(trimesh.creation.box(), angle=0.7) for _ in range(80)]
    for part in parts[::2]:
        part.visual.face_colors = (10, 20, 30, 255)
    for part in parts[1::2]:
        part.visual = trimesh.visual.TextureVisuals(uv=np.zeros((len(part.vertices), 2)), material=glass)
    corners = [part.vertices.copy() for part in parts]
    textures.redress(parts, texture_files(data), np.random.default_rng(0))
    assert all((part.vertices == before).all() for part, before in zip(parts, corners, strict=True))
    assert all(part.visual.material is glass for part in parts[1::2])
    textured = [material_image(part) is not None for part in parts[::2]]
    kept = [material_color(part)[0].tolist() == [10, 20, 30] for part in parts[::2] if material_image(part) is None]
    assert 0.3 < np.mean(textured) < 0.7
    assert 0 < np.mean(kept) < 1


def test_wrap_box_lies_flat_on_every_side() -> None:
    box = trimesh.graph.smooth_shade(trimesh.creation.box(), angle=0.7)
    wrap(box, noise(16, 0), 2.0, (0.25, 0.0))
    assert material_image(box) is not None
    for face in box.faces:
        flat = np.linalg.norm(np.diff(box.visual.uv[face], axis=0), axis=1)
        solid = np.linalg.norm(np.diff(box.vertices[face], axis=0), axis=1)
        assert flat == pytest.approx(2 * solid)


def test_piece_with_textures_has_half_of_its_materials_textured(data: Path) -> None:
    assert cli.main(["data", "textures", "--data", str(data), "--meshes", str(data.parent / "meshes")]) == 0
    rng = np.random.default_rng(0)
    parts = [part for _ in range(60) for part in piece(rng, texture_files(data))]
    assert 0.3 < np.mean([material_image(part) is not None for part in parts]) < 0.7
    assert not any(material_image(part) for part in piece(rng, []))


def test_piece_with_and_without_textures_has_the_same_shape_and_another_look(tmp_path: Path) -> None:
    texture = tmp_path / "stripes.jpg"
    Image.fromarray(np.tile(np.repeat(np.array([[0, 255]], np.uint8), 16, axis=1), (32, 4))).save(texture)
    camera = np.array([[30.0, 20.0, 3.0, 0.0]])
    pieces = [piece(np.random.default_rng(1), laid) for laid in ([], [texture])]
    views = []
    for parts in pieces:
        corners = np.concatenate([part.vertices for part in parts]).astype(np.float32)
        with closing(stage(parts, multisampling=False)) as plotter:
            views.append(shoot(plotter, camera, corners, np.random.default_rng(0))[0].astype(float))
    for plain, striped in zip(*pieces, strict=True):
        assert (plain.vertices == striped.vertices).all()
    plain_view, striped_view = views
    assert (plain_view[..., 3] == striped_view[..., 3]).all()
    assert (np.abs(plain_view[..., :3] - striped_view[..., :3]).max(axis=2) > 40).mean() > 0.05
