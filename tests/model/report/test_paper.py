"""PAPER.md from a record: tables of chairs and of all objects, and verdicts."""

from pathlib import Path

import pytest

from model.evaluation.comparison import RETRIEVAL
from model.evaluation.paper.navigation import SABB, SHORTEST_L1
from model.evaluation.paper.record import PaperRecord, Trial
from model.report.paper import navigation
from model.report.paper.page import record_path, write

SETTING = {"split": "test", "objects": 4, "view": 1, "cells": 32, "pairs": 100, "points": 10_000}
ORIGIN = {"model": "m", "machine": "x", "date": "y", "commit": "z", "seed": 0}


def _trial(method: str, success: float, optimality: float | None = 1.0) -> Trial:
    step = 0.001  # objects differ
    return Trial(
        method,
        {
            "success": [success + step * index for index in range(4)],
            "optimality": [optimality, None, optimality, optimality],
            "no path": [0.0] * 4,
        },
    )


def _record(success: float, classes: list[str], *others: Trial) -> PaperRecord:
    trials = [_trial(SHORTEST_L1, 0.3), _trial(SABB, 1.0, 0.95), _trial(RETRIEVAL, 0.6), _trial("m", success, 0.99)]
    return PaperRecord("paths", SETTING, ORIGIN, ["1", "2", "3", "4"], classes, [*trials, *others])


def test_section_says_which_claims_hold() -> None:
    text = navigation.section(_record(0.5, ["chair", "chair", "sofa", "other"]))
    assert f"Success above that of *{SHORTEST_L1}*: holds, +0.200" in text
    assert f"Paths shorter than those of *{SABB}* (optimality): holds, +0.040" in text
    assert f"success above that of {RETRIEVAL}: does not hold, -0.100" in text
    assert "Success of 0.989 on chairs: not reached" in text
    assert "direct decoder: not measured" in text
    assert "Chairs (2 objects)" in text
    assert "All objects (4)" in text


def test_section_with_a_direct_decoder_compares_it() -> None:
    text = navigation.section(_record(0.995, ["chair"] * 4, _trial("direct decoder, 9 steps", 0.7)))
    assert "Success above that of a direct decoder: holds" in text
    assert "Success of 0.989 on chairs: reached" in text


def test_section_with_a_direct_decoder_and_hof_of_as_many_steps_compares_these() -> None:
    others = (_trial("HOF-1, 9 steps", 0.6), _trial("direct decoder, 9 steps", 0.7))
    text = navigation.section(_record(0.995, ["chair"] * 4, *others))
    assert (
        "direct decoder (HOF-1, 9 steps minus direct decoder, 9 steps): does not hold, -0.100 (-0.100 to -0.100)"
        in text
    )


def test_section_without_chairs_or_successes_has_no_figures_for_them() -> None:
    text = navigation.section(_record(0.5, ["sofa"] * 4, _trial("n", 0.0, None)))
    assert "| n | 0.00" in text
    assert "on chairs:" not in text


def test_write_without_records_is_the_head_alone(tmp_path: Path) -> None:
    text = write(tmp_path).read_text()
    assert text.startswith("# The paper's experiments")
    assert "##" not in text


def test_write_with_a_damaged_record_raises_value_error(tmp_path: Path) -> None:
    path = record_path(tmp_path, "paths")
    path.parent.mkdir(parents=True)
    path.write_text("{}")
    with pytest.raises(ValueError, match="holds no record"):
        write(tmp_path)
