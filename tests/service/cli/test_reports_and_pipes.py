"""The `hof` command in a shell: reports on stderr, pipes, suffixes, signals, and the frame."""

import json
import os
import re
import signal
import subprocess
import time
from pathlib import Path

import httpx
import pytest
from PIL import Image

from service.cli.main import main
from tests.support import ROOT
from tests.support.photos import image_file
from tests.support.processes import HOF
from tests.support.small import model as tiny_model


def test_encode_tells_mask_box_confidence_files_and_points(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["encode", "photo.png", "-o", "out.ply", "--n", "70"]) == 0
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err == (
        "hof: photo.png: mask by border, confidence 1.0; box 40,30 to 81,71 of 120 x 90 pixels\n"
        "hof: out.ply: 70 points\n"
    )
    tiny_model.build(here / "estimating.onnx", estimates=True)
    assert main(["encode", "photo.png", "-o", "out.ply", "--n", "70", "--model", "estimating.onnx"]) == 0
    photo_line, estimates_line, _ = capsys.readouterr().err.splitlines()
    assert photo_line == captured.err.splitlines()[0]
    assert re.fullmatch(
        r"hof: photo\.png: shape confidence [01]\.\d+; camera at azimuth [-\d.]+, elevation [-\d.]+, "
        r"roll [-\d.]+ degrees, distance [\d.]+ longest sides",
        estimates_line,
    )
    (here / "noise.png").write_bytes(image_file(Image.effect_noise((64, 64), 90).convert("RGB")))
    assert main(["encode", "noise.png", "-o", "out.safetensors"]) == 0
    report = capsys.readouterr().err
    assert "noise.png: the whole picture; " in report
    assert "matting is off (--matting-model none)" in report
    assert "out.safetensors: weights of tiny-k2" in report


def test_encode_without_settings_uses_the_shipped_matting(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("HOF_MATTING_MODEL")
    photo = str(Path(__file__).parents[3] / "demo" / "coffee.jpg")
    assert main(["encode", photo, "-o", "cup.ply", "--n", "10"]) == 0
    assert "mask by matting, confidence 0." in capsys.readouterr().err


@pytest.mark.parametrize("name", ["OUT.PLY", "out.Npy", "out.GLB"])
def test_encode_with_a_suffix_in_any_case_writes_that_format(here: Path, name: str) -> None:
    assert main(["encode", "photo.png", "-o", name, "--n", "50"]) == 0
    assert main(["encode", "photo.png", "-o", "lower", "--format", name[4:].lower(), "--n", "50"]) == 0
    assert (here / name).read_bytes() == (here / "lower").read_bytes()


@pytest.mark.slow
def test_commands_in_a_pipe_give_the_bytes_of_files(here: Path) -> None:
    def piped(command: str, data: bytes) -> bytes:
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        run = subprocess.run([HOF, *command.split()], input=data, capture_output=True, env=environment, check=True)
        return run.stdout

    piped("encode photo.png -o a.safetensors", b"")
    piped("sample a.safetensors -o a.npy --n 500", b"")
    piped("mesh a.safetensors -o a.stl --resolution 8", b"")
    weights = piped("encode - -o - --format safetensors", (here / "photo.png").read_bytes())
    assert weights == (here / "a.safetensors").read_bytes()
    assert piped("sample - -o - --format npy --n 500", weights) == (here / "a.npy").read_bytes()
    assert piped("mesh - -o - --format stl --resolution 8", weights) == (here / "a.stl").read_bytes()
    assert json.loads(piped("info -", weights))["model"] == "tiny-k2"


@pytest.mark.parametrize(("stop", "status"), [(signal.SIGTERM, 143), (signal.SIGINT, 130)], ids=["SIGTERM", "SIGINT"])
def test_command_that_is_stopped_leaves_no_file_and_no_trace(here: Path, stop: signal.Signals, status: int) -> None:
    assert main(["encode", "photo.png", "-o", "a.safetensors"]) == 0
    before = sorted(here.iterdir())
    command = [HOF, "sample", "a.safetensors", "-o", "out.xyz", "--n", "10000000"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(command, stderr=subprocess.PIPE, env=environment) as process:
        while not any(path.name.endswith(".part") for path in here.iterdir()):
            assert process.poll() is None
            time.sleep(0.01)
        process.send_signal(stop)
        _, errors = process.communicate(timeout=60)
    assert (process.returncode, errors) == (status, b"")
    assert sorted(here.iterdir()) == before


def test_info_shows_the_frame_that_the_service_answers(
    here: Path, client: httpx.Client, capsys: pytest.CaptureFixture[str]
) -> None:
    stored = client.post("/encode", content=(here / "photo.png").read_bytes()).json()
    (here / "a.safetensors").write_bytes(client.get(stored["links"]["weights"]).content)
    assert main(["info", "a.safetensors"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["frame"], summary["dimensions"]) == (stored["frame"], stored["dimensions"])


@pytest.mark.parametrize("name", ["npy", "glb"])
def test_sample_with_frame_raw_writes_what_the_service_serves(here: Path, client: httpx.Client, name: str) -> None:
    assert main(["encode", "photo.png", "-o", "a.safetensors"]) == 0
    assert main(["sample", "a.safetensors", "-o", f"a.{name}", "--n", "500", "--frame", "raw"]) == 0
    link = client.post("/encode", content=(here / "photo.png").read_bytes()).json()["links"]["points"]
    served = client.get(link, params={"n": 500, "frame": "raw", "format": name})
    assert (here / f"a.{name}").read_bytes() == served.content
