"""A data set, packed and read again."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model.data.dataset import load_examples
from model.data.manifest import PIECES as PIECES_FOLDER
from model.data.manifest import VARIANTS, Manifest
from model.data.packed.options import PackOptions
from model.data.packed.pack import pack
from model.data.packed.shards import INDEX, quantize, read_table
from model.data.packed.strips import MAX_STRIP, decode_strip, encode_strip
from model.data.packed.tensors import Tensors, dequantize, read_packed
from service.encoding.framing import Framing
from tests.support.small import data

pytestmark = pytest.mark.slow

SIDE = 32
OPTIONS = PackOptions(
    Framing(16), lossless=True, made_views=2, variant_points=500, made_points=400, shard_bytes=400_000
)
TRAIN, PIECES = 4, 3


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four training objects with two variants each, one validation object, one test object, three made pieces."""
    folder = data.write(tmp_path_factory.mktemp("packed") / "boxes", train=TRAIN + 1, test=1)
    entries = [
        replace(each, split="val" if number == TRAIN else each.split) for number, each in enumerate(read(folder))
    ]
    Manifest(0, tuple(entries), {}, {}).write(folder / "manifest.json")
    for number in range(TRAIN):
        for variant in range(2):
            write(folder / VARIANTS / f"object{number:02d}__{variant}.npz", 20 * number + variant, 3)
    (folder / PIECES_FOLDER).mkdir()
    for number in range(PIECES):
        write(folder / PIECES_FOLDER / f"{number:05d}.npz", 100 + number, 5)
    return folder


def read(folder: Path) -> list:  # type: ignore[type-arg]
    return list(Manifest.read(folder).entries)


def write(path: Path, number: int, views: int) -> None:
    points = data.box(number)
    np.savez(path, views=data.views(points, views), points=points)


@pytest.fixture(scope="module")
def packed(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("shards")
    assert pack([folder], output, OPTIONS, processes=1) == output / INDEX
    return output


@pytest.fixture(scope="module")
def train(packed: Path) -> Tensors:
    return read_packed(packed, "train", SIDE, workers=1)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_pack_lossless_keeps_every_view_as_training_frames_it(folder: Path, train: Tensors) -> None:
    examples = load_examples(folder, "train", OPTIONS.framing, variants=True)
    for (first, own_end, end), shapes in zip(train.units.tolist(), examples.shapes, strict=False):
        crops = np.concatenate([shape.crops for shape in shapes])
        images = train.images[first:end].numpy()
        assert images.shape == crops.shape
        assert (images[..., 3] == crops[..., 3]).all()
        assert (images[..., :3] == crops[..., :3])[crops[..., 3] > 0].all()
        assert own_end - first == sum(len(shape.crops) for shape in shapes[:2])


def test_pack_quantized_keeps_points_and_their_order_with_colors(folder: Path, packed: Path) -> None:
    validation = read_packed(packed, "val", SIDE, workers=1)
    points = dequantize(validation.points).numpy()
    original = load_examples(folder, "val", OPTIONS.framing).shapes[0][0].points
    apart = np.abs(
        np.sort(points.view("f4,f4,f4"), axis=0).view("f4") - np.sort(original.view("f4,f4,f4"), axis=0).view("f4")
    )
    assert len(points) == len(original)
    assert np.median(apart) < 1e-5
    assert validation.colors is not None
    assert np.abs(validation.colors.numpy().astype(int) - data.colors(points)).max() <= 1


def test_quantize_stays_within_a_ten_thousandth_and_refuses_what_is_outside_the_box() -> None:
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (1_000, 3)).astype(np.float32)
    assert float(np.abs(dequantize(torch.from_numpy(quantize(points))).numpy() - points).max()) < 1e-5
    with pytest.raises(ValueError, match=r"a coordinate is 0\.6000 from the center"):
        quantize(np.array([[0, 0.6, 0]], np.float32))


def test_pack_keeps_limited_views_and_points_of_variants_and_made_pieces(train: Tensors) -> None:
    views = train.shape_of.bincount().tolist()
    assert views == [24, 3, 3] * TRAIN + [2] * PIECES
    assert train.counts.tolist() == [10_000, 10_000, 500] * TRAIN + [400] * PIECES
    assert train.units[-1].tolist() == [
        30 * TRAIN,
        30 * TRAIN,
        30 * TRAIN + 2 * PIECES,
    ]  # made pieces have no own views
    assert train.colors is None


def test_pack_leaves_the_test_split_out_and_keeps_shards_small(packed: Path) -> None:
    index = json.loads((packed / INDEX).read_text())
    assert len(index["shards"]) > 1
    assert all(each["bytes"] < OPTIONS.shard_bytes + 4_000 for each in index["shards"])
    rows = [row for each in index["shards"] for row in read_table(packed / each["file"])[1]]
    assert {row.split for row in rows} == {"train", "val"}
    assert {row.source for row in rows} == {"s", "made"}
    assert sum(each["views"].get("train", 0) for each in index["shards"]) == 30 * TRAIN + 2 * PIECES
    with pytest.raises(FileNotFoundError, match="hold nothing of the split test"):
        read_packed(packed, "test", SIDE, workers=1)


def test_pack_again_gives_equal_files_after_an_interruption_too(folder: Path, packed: Path, tmp_path: Path) -> None:
    shutil.copytree(packed, tmp_path, dirs_exist_ok=True)
    *_, last = sorted(tmp_path.glob("shard-*.npz"))
    last.unlink()
    (tmp_path / INDEX).unlink()
    pack([folder], tmp_path, OPTIONS, processes=2)
    assert contents(tmp_path) == contents(packed)


def test_pack_with_other_options_refuses_shards_that_are_there(folder: Path, packed: Path) -> None:
    with pytest.raises(ValueError, match="packed from other data or with other options"):
        pack([folder], packed, replace(OPTIONS, lossless=False), processes=1)


def test_read_resizes_views_and_refuses_damaged_shards(packed: Path, tmp_path: Path) -> None:
    assert read_packed(packed, "val", 2 * SIDE, workers=2).images.shape == (24, 2 * SIDE, 2 * SIDE, 4)
    with pytest.raises(FileNotFoundError, match="holds no shards: run `hof-model data pack"):
        read_packed(tmp_path, "train", SIDE, workers=1)
    shard = sorted(packed.glob("shard-*.npz"))[0]
    (tmp_path / shard.name).write_bytes(shard.read_bytes()[:1_000])
    with pytest.raises(ValueError, match="is no shard of `hof-model data pack`"):
        read_packed(tmp_path, "train", SIDE, workers=1)


def test_strip_lossy_keeps_masks_exactly() -> None:
    views = data.views(data.box(1), 3)
    decoded = decode_strip(encode_strip(views, 60), data.SIZE)
    assert (decoded[..., 3] == views[..., 3]).all()
    with pytest.raises(ValueError, match=f"wider than WebP's {MAX_STRIP}"):
        encode_strip(np.zeros((300, 64, 64, 4), np.uint8), 60)
