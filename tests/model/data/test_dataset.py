"""Examples in memory and the batches drawn from them."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model.config import TrainConfig
from model.data.dataset import Bytes, Examples, Shape, draw_batch, load_examples, plain_images
from model.data.manifest import Entry, Manifest
from model.data.sources.photographs import photograph_files
from service.encoding.framing import Framing

CONFIG = TrainConfig(framing=Framing(size=16), batch=4, points=20, target_points=50)
OBJECTS = 10


def entry(number: int) -> Entry:
    return Entry(f"s/{number}", "", "s", "c", "", "CC0", "", f"objects/{number}.npz", "train")


def crops(views: int, red: int) -> Bytes:
    """Draw a square in the left half, of one color."""
    pixels = np.zeros((views, 32, 32, 4), np.uint8)
    pixels[:, 8:24, 2:16] = [red, 30, 30, 255]
    return pixels


@pytest.fixture
def examples() -> Examples:
    """Object i is a cloud at x = i + 1, y in [0, 1) of itself and [1, 2) of its variant, its red tells i."""
    rng = np.random.default_rng(0)
    shapes = []
    for number in range(OBJECTS):
        cloud = rng.random((200, 3), np.float32) * np.array([0, 1, 1], np.float32) + np.array([number + 1, 0, 0])
        stretched = cloud + np.array([0, 1, 0])
        pair = [(4, cloud), (12, stretched)]
        shapes.append([Shape(crops(views, 20 * number), points.astype(np.float32)) for views, points in pair])
    return Examples([entry(number) for number in range(OBJECTS)], shapes, photograph_files(Path("no folder")))


def test_draw_batch_equal_seed_and_step_gives_equal_batches(examples: Examples) -> None:
    first, again = draw_batch(examples, CONFIG, 7), draw_batch(examples, CONFIG, 7)
    assert (first.images == again.images).all()
    assert (first.canonical == again.canonical).all()
    assert (first.points == again.points).all()
    for other in (draw_batch(examples, CONFIG, 8), draw_batch(examples, replace(CONFIG, seed=1), 7)):
        assert (first.images != other.images).any()
        assert (first.canonical != other.canonical).any()


def test_draw_batch_not_augmented_is_the_view_over_white_and_not_mirrored(examples: Examples) -> None:
    batch = draw_batch(examples, replace(CONFIG, augmented=False), 3)
    owners = [int(points[0, 0]) - 1 for points in batch.points]
    assert min(owners) >= 0  # x is not negated
    for owner, image in zip(owners, batch.images, strict=True):
        expected = plain_images(torch.from_numpy(crops(1, 20 * owner)), 16)[0]
        assert torch.equal(image, expected)


def test_draw_batch_two_epochs_draw_every_object_twice(examples: Examples) -> None:
    steps = 2 * OBJECTS // CONFIG.batch  # two epochs
    owners = [int(p[0, 0].abs()) - 1 for step in range(steps) for p in draw_batch(examples, CONFIG, step).points]
    assert Counter(owners) == dict.fromkeys(range(OBJECTS), 2)


def test_draw_batch_shapes_are_drawn_by_their_number_of_views(examples: Examples) -> None:
    config = replace(CONFIG, batch=40 * OBJECTS)
    stretched = (draw_batch(examples, config, 0).points[:, :, 1] >= 1).all(dim=1)
    assert float(stretched.float().mean()) == pytest.approx(12 / 16, abs=0.07)


def test_draw_batch_own_share_draws_own_shapes_more_often(examples: Examples) -> None:
    """Own shapes get 0.6 of the draws and their part of the rest; procedural pieces have no own shape."""
    shapes = [[own, replace(own, points=own.points + 1), *[other] * 3] for own, other in examples.shapes]
    config = replace(CONFIG, batch=80 * OBJECTS, own_share=0.6)
    for drawn_from, share in (
        (replace(examples, shapes=shapes), 0.6 + 0.4 * 8 / 44),
        (replace(examples, shapes=[], pieces=shapes), 8 / 44),
    ):
        own = (draw_batch(drawn_from, config, 0).points[:, :, 1] < 1).all(dim=1)
        second = (draw_batch(drawn_from, config, 0).points[:, :, 2] >= 1).all(dim=1)
        assert float((own | second).float().mean()) == pytest.approx(share, abs=0.07)


def test_draw_batch_image_and_points_match_and_are_mirrored_together(examples: Examples) -> None:
    config = replace(CONFIG, batch=200)
    batch = draw_batch(examples, config, 0)
    mirrored = 0
    for image, points in zip(batch.images, batch.points, strict=True):
        signs = points[:, 0].sign()
        assert (signs == signs[0]).all()
        if not (image[:, :2] == 1).all():
            continue  # where the ground is white the object is what is dark
        dark = (image < 0.9).any(dim=0).float().sum(dim=0)
        assert (dark[:8].sum() > dark[8:].sum()) == (signs[0] > 0)
        mirrored += int(signs[0] < 0)
        red, green, _ = image[:, 8, dark.argmax()].tolist()
        if abs(red - green) > 0.1:  # else gray, or dark
            assert (red > green) == (points[0, 0].abs() > 2.5)  # the first two objects have less red than green
    assert 20 < mirrored < 80


def test_draw_batch_mirrored_points_keep_their_colors(examples: Examples) -> None:
    assert draw_batch(examples, CONFIG, 0).colors is None  # variants have none
    shapes = [own.points[:, 1:] * 255 for own, _ in examples.shapes]
    colors = [
        np.pad(values, ((0, 0), (1, 0)), constant_values=number).astype(np.uint8)
        for number, values in enumerate(shapes)
    ]
    colored = [[replace(own, colors=rgb)] for (own, _), rgb in zip(examples.shapes, colors, strict=True)]
    batch = draw_batch(replace(examples, shapes=colored), replace(CONFIG, batch=20), 0)
    assert batch.colors is not None
    assert (batch.colors[..., 0] + 1 == batch.points[..., 0].abs()).all()
    assert (batch.colors[..., 1:] == (batch.points[..., 1:] * 255).byte()).all()
    assert (batch.points[:, 0, 0] < 0).any()


def test_plain_images_crops_are_put_over_white() -> None:
    image = plain_images(torch.from_numpy(crops(1, 255)), 16)
    assert image.shape == (1, 3, 16, 16)
    assert image[0, :, 8, 4].tolist() == pytest.approx([1, 30 / 255, 30 / 255])
    assert image[0, :, 0, 0].tolist() == [1, 1, 1]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Write a data set as `build` leaves it: two objects to train on, one to validate."""
    entries = (entry(0), entry(1), replace(entry(2), split="val"))
    Manifest(0, entries, {}, {}).write(tmp_path / "manifest.json")
    for number, one in enumerate(entries):
        write(tmp_path / one.file, 24, number)
    return tmp_path


def write(path: Path, views: int, level: int) -> None:
    path.parent.mkdir(exist_ok=True)
    np.savez_compressed(path, views=crops(views, 20 * level), points=np.full((100, 3), level, np.float32))


def test_load_examples_split_is_loaded_and_framed(folder: Path) -> None:
    train = load_examples(folder, "train", CONFIG.framing)
    assert [one.id for one in train.entries] == ["s/0", "s/1"]
    images, points = train.built(5)
    assert images.shape == (2, 32, 32, 4)
    assert images[1, 16, 16].tolist() == [20, 30, 30, 255]  # what stood at the left is in the middle
    assert (points == np.arange(2)[:, None, None]).all()


def test_load_examples_with_variants_loads_them(folder: Path) -> None:
    with pytest.raises(FileNotFoundError, match="hof-model data vary --data"):
        load_examples(folder, "train", CONFIG.framing, variants=True)
    for name in ("0__0", "0__1", "0__2", "1__0", "2__0"):  # object 1 has not been stretched
        write(folder / "variants" / f"{name}.npz", 3, 3 + int(name[-1]))
    train = load_examples(folder, "train", CONFIG.framing, variants=True)
    assert [[len(shape.crops) for shape in shapes] for shapes in train.shapes] == [[24, 3, 3, 3], [24, 3]]
    assert [shape.points[0, 0] for shape in train.shapes[0]] == [0, 3, 4, 5]
    (_, free), *_ = load_examples(folder, "val", CONFIG.framing, variants=True).shapes
    assert free.crops[2, 16, 16].tolist() == [60, 30, 30, 255]
    assert (free.points == 3).all()
    for name in ("0__1", "0__2"):
        (folder / "variants" / f"{name}.npz").unlink()
    with pytest.raises(FileNotFoundError, match="holds no stretched shapes: run `hof-model data vary"):
        load_examples(folder, "train", CONFIG.framing, variants=True)
