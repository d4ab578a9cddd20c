"""From ShapeNet's files to a row of Table 1, by the commands of docs/training.md."""

import json
from pathlib import Path

import pytest

from model import cli
from model.config import PAPER_SCHEDULE
from model.training.checkpoints import load_network
from tests.support.small import shapenet

TINY = ["--feature-maps", "4", "4", "4", "--convolutions", "1", "--fully-connected", "16", "--hidden", "8", "--k", "1"]


@pytest.mark.slow
def test_paper_schedule_on_ptn_trains_and_the_protocol_prints_the_row_of_table_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data, run = f"shapenet-ptn:{shapenet.write_ptn(tmp_path / 'ptn')}", tmp_path / "run"
    command = ["train", "--data", data, "--schedule", "paper", "--run", str(run), *TINY]
    assert cli.main([*command, "--points", "20", "--device", "cpu"]) == 0
    _, config, spent = load_network(run / "best.pt")
    assert spent["step"] == 4 * 3 * 24  # epochs, objects, views
    assert (config.batch, config.learning_rate, config.framing.size, config.points) == (1, 1e-5, 64, 20)
    assert (config.augmented, config.constant_rate, config.encoder.rank) == (False, True, 0)
    assert config.target_points == PAPER_SCHEDULE.target_points
    record = tmp_path / "epcg.json"
    evaluate = ["evaluate", "--protocol", "epcg", "--run", str(run), "--data", data, "--split", "test"]
    assert cli.main([*evaluate, "-o", str(record)]) == 0
    printed = capsys.readouterr().out
    assert "| Method | CD(P,T) | CD(T,P) | Average CD | Parameters | Layers |" in printed
    assert "2 objects of the test split, 24 views each, 10,000\npredicted against 12,000 true points" in printed
    assert "| chair | 2 |" in printed
    assert json.loads(record.read_text())["classes"] == ["chair", "chair"]


def test_schedule_with_its_own_budget_keeps_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["train", "--data", f"what3d:{tmp_path}", "--schedule", "paper"]) == 2
    assert "is missing; this layout is expected" in capsys.readouterr().err
