"""The section of RESULTS.md on runs."""

from pathlib import Path

import numpy as np
import pytest

from model import cli
from model.evaluation.comparison import ORACLE
from model.evaluation.locations import RUNS
from model.evaluation.records import Record
from model.report import runs
from model.report.tables import loss
from model.training.state import RunState
from tests.support.small import data as small_data
from tests.support.small import network as small_network

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    data = small_data.write(folder / "data", train=3, test=2)
    state = RunState(small_network.CONFIG)
    state.step, state.elapsed_s = 1234, 90.0
    (folder / "run").mkdir()
    state.save(folder / "run", score=0)
    command = ["evaluate", "--run", str(folder / "run"), "--data", str(data), "--split", "test", "--photographs"]
    assert cli.main([*command, "--references", "-o", str(folder / RUNS / "run-1.json")]) == 0
    return folder


def test_section_run_with_oracle_has_a_row_for_each(root: Path) -> None:
    record = Record.read(root / RUNS / "run-1.json")
    own, oracle = (line for line in runs.section(root).splitlines() if line.startswith(("| run-1", f"| {ORACLE}")))
    assert own.startswith("| run-1 | 1,234 | 1.5 |")
    assert own.endswith(f"| {loss(record.evaluations, 'run-1', 'photograph'):.1f}% |")
    figures = next(evaluation.column("f@2%") for evaluation in record.evaluations if evaluation.method == ORACLE)
    assert f"{np.mean(figures):.3f} (" in oracle
    assert "2 objects of the\ntest split" in runs.section(root)


def test_section_two_runs_have_one_row_for_the_oracle(root: Path, tmp_path: Path) -> None:
    record = Record.read(root / RUNS / "run-1.json")
    for name in ("run-1", "run-2"):
        record.write(tmp_path / RUNS / f"{name}.json")
    lines = runs.section(tmp_path).splitlines()
    assert sum(line.startswith(f"| {ORACLE}") for line in lines) == 1


def test_section_without_records_is_empty(tmp_path: Path) -> None:
    assert runs.section(tmp_path) == ""
