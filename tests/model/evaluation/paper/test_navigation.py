"""Paths planned on predictions: what the methods know decides what they reach."""

from pathlib import Path

import numpy as np
import pytest

from model import cli
from model.evaluation.comparison import ELLIPSOID, ORACLE, RETRIEVAL
from model.evaluation.paper import navigation
from model.evaluation.paper.navigation import AS_SERVED, PAIRS, SABB, SHORTEST_L1, job_of, navigate
from model.evaluation.paper.record import PaperRecord
from model.report.paper.page import record_path
from tests.support.small import data as small_data

Figures = dict[str, tuple[float, float, float]]


def _box(half: tuple[float, float, float], n: int = 20_000) -> navigation.Floats:
    """Draw points on the faces of a box."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-1, 1, (n, 3))
    points[np.arange(n), rng.integers(3, size=n)] = rng.choice([-1, 1], n)
    return (points * half).astype(np.float32)


@pytest.fixture(scope="module")
def figures() -> Figures:
    true = _box((0.5, 0.1, 0.2))
    shapes = {
        "truth": true,
        "nothing": np.zeros((0, 3), np.float32),
        "too large": _box((0.6, 0.6, 0.6)),
    }
    return navigate(job_of(true, shapes, (1, 2)))


def test_navigate_on_the_truth_always_succeeds_by_a_shortest_path(figures: Figures) -> None:
    assert figures["truth"] == (1, 1, 0)


def test_navigate_around_the_true_box_always_succeeds(figures: Figures) -> None:
    success, optimality, no_path = figures[SABB]
    assert (success, no_path) == (1, 0)
    assert optimality == 1  # this object is its box


def test_navigate_without_obstacles_collides_and_is_never_longer(figures: Figures) -> None:
    success, optimality, no_path = figures[SHORTEST_L1]
    assert 0 < success < 0.9
    assert (optimality, no_path) == (1, 0)
    assert figures["nothing"] == figures[SHORTEST_L1]


def test_navigate_with_start_inside_a_prediction_finds_no_path(figures: Figures) -> None:
    success, _, no_path = figures["too large"]
    assert 0 < no_path < 1
    assert success <= 1 - no_path


def test_navigate_on_a_larger_box_is_free_but_longer() -> None:
    figures = navigate(job_of(_box((0.5, 0.1, 0.2)), {"larger": _box((0.55, 0.3, 0.3))}, (1,)))
    success, optimality, _ = figures["larger"]
    assert success > 0.9
    assert optimality < 1


def test_navigate_without_a_success_has_no_optimality() -> None:
    full = np.random.default_rng(0).uniform(-1, 1, (10**6, 3)).astype(np.float32)
    success, optimality, no_path = navigate(job_of(_box((0.5, 0.5, 0.5)), {"full": full}, (1,)))["full"]
    assert (success, no_path) == (0, 1)
    assert np.isnan(optimality)


@pytest.mark.slow
def test_command_paper_paths_writes_record_and_page(
    model_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = small_data.write(tmp_path / "data", train=2, test=2)
    command = ["paper", "paths", "--model", str(model_path), "--data", str(data), "-o", str(tmp_path)]
    assert cli.main(command) == 0
    assert capsys.readouterr().out == f"{tmp_path / 'PAPER.md'}\n"
    record = PaperRecord.read(record_path(tmp_path, "paths"))
    assert (record.setting["objects"], record.setting["pairs"]) == (2, PAIRS)
    assert [trial.method for trial in record.trials] == [
        SHORTEST_L1,
        SABB,
        ELLIPSOID,
        RETRIEVAL,
        ORACLE,
        "tiny-k2",
        "tiny-k2, 100,000 points",
        f"tiny-k2, {AS_SERVED}",
    ]
    assert record.trial(SABB).figures["success"] == [1, 1]
    page = (tmp_path / "PAPER.md").read_text()
    assert "## Collision-free paths" in page
    assert cli.main(["paper", "page", "-o", str(tmp_path)]) == 0
    assert (tmp_path / "PAPER.md").read_text() == page
