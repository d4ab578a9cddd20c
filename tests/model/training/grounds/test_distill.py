"""Distillation: pairs of images, the loss, a short run, and the file that it writes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from model import cli
from model.config import LITE0, DistillConfig
from model.data.dataset import load_examples
from model.data.manifest import Manifest, variant_file
from model.export import export
from model.networks.color_head import ColorHead, color_spec, look
from model.networks.encoder import ImageEncoder
from model.networks.mapping import power
from model.training.grounds.distill import (
    FEATURES_WEIGHT,
    POINTS,
    POINTS_WEIGHT,
    DistillLoss,
    _matted,
    answers,
    distill,
    draw_pairs,
    prepared,
)
from service.encoding.encoder import Encoder
from service.encoding.framing import MOST_MOVED
from service.encoding.masks import TRACE, Matte
from service.encoding.matting import Matting
from service.mapping.canonical import canonical_points
from service.settings import SHIPPED_MATTING
from tests.support.small import data as small_data
from tests.support.small.network import CONFIG as DENSE

CONFIG = replace(DENSE, encoder=replace(LITE0, frozen=0), batch=4)
SIZE = CONFIG.framing.size


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a data set with all splits, variants of its objects, and a piece."""
    folder = small_data.write(tmp_path_factory.mktemp("distill") / "data", train=2, test=2)
    manifest = Manifest.read(folder)
    entries = [*manifest.entries[:-1], replace(manifest.entries[-1], split="val")]
    replace(manifest, entries=tuple(entries)).write(folder / "manifest.json")
    (folder / "made").mkdir()
    for entry in entries:
        with np.load(folder / entry.file) as arrays:
            for number in range(3):
                np.savez(variant_file(folder, entry, number), views=arrays["views"][:2], points=arrays["points"])
            np.savez(folder / "made" / f"{entry.id}.npz", views=arrays["views"][:1], points=arrays["points"])
    return folder


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Export a small model with color, its trunk lite0."""
    torch.manual_seed(0)
    encoder = ImageEncoder(CONFIG.spec, CONFIG.encoder, SIZE).eval()
    inputs = look(encoder, torch.zeros(1, 3, SIZE, SIZE))[1].shape[1]
    card = {"name": "small", "training": {"minutes": 0, "steps": 0, "config": CONFIG.to_dict()}}
    card |= {"data": {"objects": {"train": 0, "val": 0, "test": 0}, "licences": []}, "figures": {}, "limits": []}
    card |= {"exported": {"date": "d", "machine": "m", "commit": "c"}, "trunk": "t", "method": "m", "license": "l"}
    path = tmp_path_factory.mktemp("model") / "small.onnx"
    export(encoder, CONFIG, card, path, ColorHead(color_spec(CONFIG.spec), inputs).eval())
    return path


def _left_half(image: Image.Image) -> Matte:
    matte = np.zeros((image.height, image.width), np.uint8)
    matte[:, : image.width // 2] = 255
    return matte


def test_prepared_of_another_trunk_raises_value_error() -> None:
    encoder = ImageEncoder(DENSE.spec, DENSE.encoder, SIZE)
    with pytest.raises(ValueError, match="trunk is not lite0"):
        prepared(encoder)


def test_prepared_freezes_the_last_layer_and_the_stem_alone() -> None:
    student = prepared(ImageEncoder(CONFIG.spec, CONFIG.encoder, SIZE))
    frozen = {name for name, weight in student.named_parameters() if not weight.requires_grad}
    assert frozen - {"features.lite0.stem.weight", "features.lite0.stem.bias"} == {
        "head.linear.weight",
        "head.linear.bias",
    }


def test_loss_of_the_same_images_is_zero_and_of_others_is_not() -> None:
    teacher = ImageEncoder(CONFIG.spec, CONFIG.encoder, SIZE).eval()
    student, images = prepared(teacher).eval(), torch.rand(3, 3, SIZE, SIZE)
    expected = answers(teacher, images)
    loss = DistillLoss(teacher, CONFIG.spec, expected)
    with torch.no_grad():
        same, other = (float(loss(student, shown, expected)) for shown in (images, images.flip(0)))
    assert same < 1e-6
    assert other > 0.1


def test_loss_of_other_points_is_their_distance_weighted() -> None:
    teacher = ImageEncoder(CONFIG.spec, CONFIG.encoder, SIZE).eval()
    images = torch.rand(3, 3, SIZE, SIZE)
    expected = answers(teacher, images)
    loss, student = DistillLoss(teacher, CONFIG.spec, expected), prepared(teacher).eval()
    with torch.no_grad():
        *_, bias = student.dense.parameters()  # of the features
        bias.add_(0.1)
        drawn = answers(student, images)[:, : teacher.width]
        points = torch.from_numpy(canonical_points(CONFIG.spec.domain, POINTS, 0)).expand(3, -1, -1).contiguous()
        clouds = [power(CONFIG.spec, teacher.head(each), points) for each in (drawn, expected[:, : teacher.width])]
        error = (drawn - expected[:, : teacher.width]).square().mean() / expected[:, : teacher.width].var(dim=0).mean()
        distance = (clouds[0] - clouds[1]).norm(dim=2).mean()
        assert distance > 1e-4
        total = POINTS_WEIGHT * distance + FEATURES_WEIGHT * error
        torch.testing.assert_close(loss(student, images, expected), total, rtol=1e-4, atol=1e-6)


def test_draw_pairs_are_of_the_same_views(data: Path) -> None:
    examples = load_examples(data, "train", CONFIG.framing, variants=True, pieces=True)
    images, plain = draw_pairs(examples, replace(CONFIG, batch=16), 0, None)
    assert images.shape == plain.shape == (16, 3, SIZE, SIZE)
    again = draw_pairs(examples, replace(CONFIG, batch=16), 0, None)
    assert torch.equal(images, again[0])
    assert (plain[:, :, 0] > 0.99).all()
    is_object = (plain < 0.9).any(dim=1).flatten(1).float()
    darkness = (1 - images.mean(dim=1)).flatten(1)
    over_white = (images[:, :, 0] > 0.97).flatten(1).all(dim=1)
    alike = torch.corrcoef(torch.cat([darkness, is_object]))[:16, 16:]
    assert over_white.any()
    assert (alike[over_white].argmax(dim=1) == torch.arange(16)[over_white]).float().mean() > 0.7
    assert (images[:, :, 0] < 0.97).flatten(1).any(dim=1).float().mean() > 0.5


def test_matted_before_a_background_is_framed_with_a_trace_of_it() -> None:
    dark = torch.rand(3, SIZE, SIZE) / 2
    half = _matted(dark, CONFIG.framing, _left_half)
    beyond, middle = SIZE // 4 - round(MOST_MOVED * SIZE), SIZE // 2
    shown = dark[..., : SIZE - beyond].clone()
    shown[..., middle:] = 1 - TRACE / 255 * (1 - shown[..., middle:])
    assert (half[..., :beyond] == 1).all()
    torch.testing.assert_close(half[..., beyond:], shown, atol=2 / 255, rtol=0)


def test_matted_without_a_mask_or_over_white_returns_the_image() -> None:
    dark, white = torch.rand(3, SIZE, SIZE) / 2, torch.ones(3, SIZE, SIZE)
    white[:, SIZE // 2 :] = 0.2
    assert torch.equal(_matted(dark, CONFIG.framing, lambda image: np.zeros(image.size, np.uint8)), dark)
    assert torch.equal(_matted(white, CONFIG.framing, _left_half), white)


@pytest.mark.slow
def test_distill_goes_on_from_its_checkpoint(data: Path, model: Path, tmp_path: Path) -> None:
    config, matting = DistillConfig(minutes=0.01, batch=4), Matting(SHIPPED_MATTING, 1)
    first = torch.load(distill(data, model, tmp_path, config, matting), weights_only=True)
    later = torch.load(distill(data, model, tmp_path, replace(config, minutes=0.05), matting), weights_only=True)
    assert 0 < first["step"] < later["step"]
    assert all(weight.isfinite().all() for weight in later["average"].values())
    assert "error" in (tmp_path / "log.jsonl").read_text()


@pytest.mark.slow
def test_distill_of_a_run_of_another_model_raises_value_error(data: Path, model: Path, tmp_path: Path) -> None:
    config, matting = DistillConfig(minutes=0.01, batch=4), Matting(SHIPPED_MATTING, 1)
    run = distill(data, model, tmp_path, config, matting)
    torch.save(torch.load(run, weights_only=True) | {"origin": "another"}, run)
    with pytest.raises(ValueError, match="is a run of another model: name another folder with --run"):
        distill(data, model, tmp_path, config, matting)


@pytest.mark.slow
def test_distill_command_changes_theta_and_keeps_the_outputs(data: Path, model: Path, tmp_path: Path) -> None:
    output = tmp_path / "distilled.onnx"
    options = ["--data", str(data), "--model", str(model), "--run", str(tmp_path), "--minutes", "0.02", "--batch", "4"]
    assert cli.main(["distill", *options, "-o", str(output)]) == 0
    before, after = Encoder.open(model, 1), Encoder.open(output, 1)
    assert after.outputs == before.outputs
    assert after.card["distilled"]["steps"] > 0
    assert "cd_forward" in after.card["figures"]["small"]
    assert "**Distilled**" in output.with_suffix(".md").read_text()
    images = np.random.default_rng(0).random((1, 3, SIZE, SIZE), np.float32)
    assert np.abs(before.encode(images)[0].theta - after.encode(images)[0].theta).max() > 0
