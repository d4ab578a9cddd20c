"""`hof encode` with points of a part of an object."""

import re
from pathlib import Path

import numpy as np
import pytest

from service.cli.main import main
from tests.support.small import model as tiny_model
from tests.support.small.data import box


@pytest.fixture
def scan(here: Path, monkeypatch: pytest.MonkeyPatch, model_path: Path) -> Path:
    """Write scan.npy, and name a model of images and one of points."""
    np.save(here / "scan.npy", box(1)[:500])
    tiny_model.build_points(here / "points.onnx")
    monkeypatch.setenv("HOF_MODEL", f"{model_path},points.onnx")
    return here


def test_encode_of_points_takes_the_model_of_points(scan: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["encode", "scan.npy", "-o", "whole.npy", "--n", "300"]) == 0
    first, last = capsys.readouterr().err.splitlines()
    turned = r"(, turned about \+Y by \d+ degrees,)?"
    assert re.match(rf"hof: scan\.npy: 500 points; the object frame{turned} times \d", first)
    assert last == "hof: whole.npy: 300 points"
    assert np.load(scan / "whole.npy").shape == (300, 3)
    assert main(["encode", "photo.png", "-o", "photo.safetensors"]) == 0
    assert "weights of tiny-k2" in capsys.readouterr().err


def test_encode_of_faulty_points_names_the_file(scan: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (scan / "few.xyz").write_text("1 2 3\n")
    assert main(["encode", "few.xyz", "-o", "out.ply"]) == 2
    assert "few.xyz: there are 1 points, at least 64 are needed" in capsys.readouterr().err
    assert main(["encode", "scan.npy", "--view", "photo.png", "-o", "out.ply"]) == 2
    assert "scan.npy has points: --view is for photos" in capsys.readouterr().err


def test_encode_of_points_without_a_model_for_them_names_the_setting(
    scan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["encode", "scan.npy", "-o", "out.ply", "--model", str(scan / "points.onnx")]) == 0
    capsys.readouterr()
    tiny_model.build(scan / "images.onnx")
    assert main(["encode", "scan.npy", "-o", "out.ply", "--model", str(scan / "images.onnx")]) == 2
    assert "no model for points or meshes is loaded: name one with --model" in capsys.readouterr().err
