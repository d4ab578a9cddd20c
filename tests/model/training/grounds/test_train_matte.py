"""Training of the matte network: the loss, a short run that is resumed, and the exported file."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from model import cli
from model.config import MatteConfig
from model.data.manifest import Manifest, variant_file
from model.training.grounds.train_matte import load_composites, load_matte, matte_loss, overlap, train_matte
from service.encoding.matting import Matting
from tests.support.small import data as small_data

CONFIG = MatteConfig(minutes=0.01, size=32, batch=4)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a data set with a validation split, free cameras of the training objects, and a piece."""
    folder = small_data.write(tmp_path_factory.mktemp("matte") / "data", train=2, test=2)
    manifest = Manifest.read(folder)
    entries = [replace(each, split="val") if each.split == "test" else each for each in manifest.entries]
    replace(manifest, entries=tuple(entries)).write(folder / "manifest.json")
    (folder / "made").mkdir()
    for entry in entries:
        with np.load(folder / entry.file) as arrays:
            np.savez(variant_file(folder, entry, 0), views=arrays["views"][:2])
            np.savez(folder / "made" / f"{entry.id}.npz", views=arrays["views"][:1])
    return folder


def test_matte_loss_of_the_truth_is_small_and_of_its_opposite_large() -> None:
    mattes = torch.zeros(2, 1, 8, 8)
    mattes[:, :, 2:6, 2:6] = 1
    right, wrong = (float(matte_loss(sign * 20 * (2 * mattes - 1), mattes)) for sign in (1, -1))
    assert right < 1e-3
    assert wrong > 10


def test_overlap_of_the_truth_is_one_and_of_a_half_one_half() -> None:
    mattes = torch.zeros(1, 1, 8, 64)
    mattes[..., :32] = 1
    half = torch.full_like(mattes, -1.0)
    half[..., :16] = 1

    def answer(logits: torch.Tensor) -> float:
        network = torch.nn.Module()
        network.forward = lambda _: logits
        return overlap(network, (torch.zeros(1, 3, 8, 64), mattes))

    assert answer(2 * mattes - 1) == 1
    assert answer(half) == pytest.approx(0.5, abs=0.01)


def test_load_composites_of_training_adds_variants_and_pieces(data: Path) -> None:
    assert len(load_composites(data, "train").views) == 2 * (8 + 2) + 4
    assert len(load_composites(data, "val").views) == 2 * 8


def test_train_matte_resumes_where_it_stopped(data: Path, tmp_path: Path) -> None:
    checkpoint = train_matte(data, tmp_path, CONFIG)
    network, first = load_matte(checkpoint)
    assert not network.training
    assert first["steps"] > 0
    log = tmp_path / "log.jsonl"
    with log.open("a") as file:
        file.write(json.dumps({"step": first["steps"] + 1, "overlap": -1}) + "\n")  # written, but not saved
    train_matte(data, tmp_path, replace(CONFIG, minutes=0.03))
    assert load_matte(checkpoint)[1]["steps"] > first["steps"]
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    assert sum("overlap" in line for line in lines) == 2
    assert min(line.get("overlap", 0) for line in lines) >= 0


def test_matte_without_pieces_names_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = small_data.write(tmp_path / "data", train=1, test=1)
    assert (
        cli.main(["matte", "--data", str(folder), "--run", str(tmp_path / "run"), "-o", str(tmp_path / "m.onnx")]) == 2
    )
    assert "hof-model data vary" in capsys.readouterr().err


@pytest.mark.slow
def test_matte_command_writes_a_file_that_the_service_opens(data: Path, tmp_path: Path) -> None:
    output = tmp_path / "own.onnx"
    options = ["--minutes", "0.01", "--size", "64", "--batch", "4"]
    assert cli.main(["matte", "--data", str(data), "--run", str(tmp_path), "-o", str(output), *options]) == 0
    matting = Matting.of(output, 1)
    assert matting is not None
    assert matting.side == 64
    assert matting(Image.new("RGB", (90, 50))).shape == (50, 90)
    assert "# Model card: own" in output.with_suffix(".md").read_text()
