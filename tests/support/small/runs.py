"""A run that takes seconds, and its log."""

import json
from dataclasses import replace
from pathlib import Path

from model import cli
from tests.support.small import network

RUN = replace(network.CONFIG, points=128, target_points=200, learning_rate=3e-3, steps=100)


def records(run: Path) -> list[dict[str, float]]:
    """Return the lines of a run's log."""
    return [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]


def export_run(run: Path, data: Path, output: Path) -> Path:
    """Export a run by `hof-model export`, and return the ONNX file."""
    assert cli.main(["export", "--run", str(run), "--data", str(data), "-o", str(output)]) == 0
    return output
