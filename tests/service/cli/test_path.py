"""`hof path` gives what the service gives."""

import json
from pathlib import Path

import httpx
import pytest

from service.cli.main import main
from tests.support.small.ball import ball_file

ENDS = ["--start", "-0.9", "0.1", "0", "--goal", "0.9", "0.1", "0"]


@pytest.fixture
def ball(here: Path) -> str:
    (here / "ball.safetensors").write_bytes(ball_file())
    return "ball.safetensors"


@pytest.mark.parametrize("name", ["json", "glb"])
def test_path_writes_the_path_that_the_service_plans(here: Path, ball: str, client: httpx.Client, name: str) -> None:
    assert main(["path", ball, *ENDS, "-o", f"out.{name}", "--cells", "24", "--clearance", "0.1"]) == 0
    link = client.post("/objects", content=ball_file()).json()["links"]["self"]
    body = {"start": [-0.9, 0.1, 0], "goal": [0.9, 0.1, 0], "cells": 24, "clearance": 0.1}
    served = client.post(f"{link}/path?format={name}", json=body)
    assert (here / f"out.{name}").read_bytes() == served.content


def test_path_without_a_way_is_null(ball: str) -> None:
    assert main(["path", ball, *ENDS[:4], "--goal", "0", "0", "0", "-o", "out.json"]) == 0
    assert json.loads(Path("out.json").read_text())["reason"] == "enclosed"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--start", "a", "0", "0"], "start: Input should be a valid number"),
        (["--start", "2", "0", "0"], "start is [2, 0, 0], it must lie between [-1, -1, -1]"),
        (["--cells", "65"], "cells: Input should be less than or equal to 64"),
        (["--goal", "0", "0", "0", "--format", "glb"], "there is no path (enclosed)"),
    ],
)
def test_path_that_cannot_be_planned_fails(
    ball: str, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    assert main(["path", ball, *ENDS, "-o", "out.json", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert not Path("out.json").exists()
