"""`--frame camera` gives what the service gives."""

from pathlib import Path

import httpx
import numpy as np
import pytest

from service.cli.main import main
from tests.support.small import model as tiny_model
from tests.support.small.ball import ball_file

CAMERA = ["--frame", "camera", "--azimuth", "30", "--elevation", "20", "--distance", "3"]
QUERY = "frame=camera&azimuth=30&elevation=20&distance=3"


def test_sample_and_mesh_write_the_files_that_the_service_gives(here: Path, client: httpx.Client) -> None:
    (here / "ball.safetensors").write_bytes(ball_file())
    links = client.post("/objects", content=ball_file()).json()["links"]
    assert main(["sample", "ball.safetensors", *CAMERA, "--scale", "2", "-o", "ball.ply"]) == 0
    assert (here / "ball.ply").read_bytes() == client.get(f"{links['points']}?{QUERY}&scale=2").content
    assert main(["mesh", "ball.safetensors", *CAMERA, "--resolution", "8", "-o", "ball.obj"]) == 0
    served = client.get(f"{links['mesh']}?{QUERY}&resolution=8&format=obj").content
    assert (here / "ball.obj").read_bytes() == served


def test_encode_uses_the_camera_that_the_model_estimates(here: Path) -> None:
    model = tiny_model.build(here / "estimating.onnx", estimates=True)
    command = ["encode", "photo.png", "--model", str(model), "--frame", "camera", "-o"]
    assert main([*command, "seen.npy"]) == 0
    assert main([*command, "near.npy", "--distance", "1.5"]) == 0
    viewed, near = np.load(here / "seen.npy"), np.load(here / "near.npy")
    assert (viewed[:, 2] > 0).all()
    assert near[:, 2].mean() < viewed[:, 2].mean()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["sample", "ball.safetensors", "--frame", "camera", "-o", "x.ply"], "give azimuth, elevation, distance"),
        (["sample", "ball.safetensors", "--azimuth", "3", "-o", "x.ply"], "azimuth needs frame=camera"),
        (["mesh", "ball.safetensors", *CAMERA, "--fx", "500", "-o", "x.ply"], "fx needs a photo"),
        (["sample", "ball.safetensors", *CAMERA, "--roll", "x", "-o", "x.ply"], "roll: Input should be a valid number"),
    ],
)
def test_camera_frame_without_a_whole_camera_fails(
    here: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    (here / "ball.safetensors").write_bytes(ball_file())
    assert main(arguments) == 2
    assert message in capsys.readouterr().err
    assert not (here / "x.ply").exists()
