"""The demo, run as `make demo` runs it."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from tests.support import ROOT

RUN_TIMEOUT_S = 120

pytestmark = pytest.mark.server


def _demo(model: Path, out: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(ROOT / "demo" / "run.py"), "--out", str(out)],
        env={**os.environ, "HOF_MODEL": str(model)},
        capture_output=True,
        text=True,
        timeout=RUN_TIMEOUT_S,
        check=False,
    )


def test_demo_with_a_model_writes_points_and_a_picture(model_path: Path, tmp_path: Path) -> None:
    run = _demo(model_path, tmp_path / "out")
    assert run.returncode == 0, run.stderr
    photos = {path.stem for path in (ROOT / "demo").iterdir() if path.suffix in (".png", ".jpg")} - {"demo"}
    files = {f"{photo}{suffix}" for photo in photos for suffix in (".ply", ".glb")}
    assert {path.name for path in (tmp_path / "out").iterdir()} == files | {"demo.png"}
    clouds = [trimesh.load(tmp_path / "out" / f"coffee{suffix}", process=False) for suffix in (".ply", ".glb")]
    assert clouds[0].vertices.shape == (20_000, 3)
    assert (clouds[0].vertices == next(iter(clouds[1].geometry.values())).vertices).all()
    with Image.open(tmp_path / "out" / "demo.png") as picture:
        assert picture.size == (960, 480 * len(photos))
        points = picture.crop((480, 0, 960, 480)).convert("L")
    assert points.histogram()[255] < 480 * 480 - 100  # the object's half is not blank


def test_demo_with_colors_draws_them(model_path: Path, colored_path: Path, tmp_path: Path) -> None:
    pictures = {}
    for name, model in (("plain", model_path), ("colored", colored_path)):
        assert _demo(model, tmp_path / name).returncode == 0
        with Image.open(tmp_path / name / "demo.png") as picture:
            points = np.asarray(picture.convert("RGB"))[:480, 480:]
        pictures[name] = bool((points[..., 0] > points[..., 2]).any())  # shades without color are bluish
    assert pictures == {"plain": False, "colored": True}
    cloud = trimesh.load(tmp_path / "colored" / "coffee.ply", process=False)
    assert len(np.unique(cloud.colors, axis=0)) > 10


def test_demo_without_its_model_fails_with_one_line(tmp_path: Path) -> None:
    run = _demo(tmp_path / "none.onnx", tmp_path / "out")
    assert run.returncode == 1
    assert "none.onnx" in run.stderr
    assert run.stderr.splitlines()[-1] == "demo: hof serve ended with status 2"
    assert not (tmp_path / "out" / "demo.png").exists()
