"""Tables and targets from evaluations of fixed means."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from model.evaluation.comparison import COUNTS, ELLIPSOID, ORACLE, RETRIEVAL
from model.evaluation.conditions import CONDITIONS, Condition
from model.evaluation.evaluate import Evaluation
from model.evaluation.records import Decoder
from model.metrics import NAMES
from model.report import tables
from model.report.targets import checks, target_table

CLASSES = ["bed", "chair", "chair", "other"] * 5


def evaluation(
    method: str, distance: float, score: float, condition: Condition = "plain", n: int = 10_000
) -> Evaluation:
    """Twenty objects around these means, the same deviations for every method."""
    noise = np.random.default_rng(0).normal(0, 0.05, len(CLASSES))
    figures = {name: (score if name.startswith("f@") else distance) + noise - noise.mean() for name in NAMES}
    return Evaluation(method, figures, condition, n)


def everything(lost: float = 0.01) -> Iterator[Evaluation]:
    for condition in CONDITIONS:
        yield evaluation("ours", 2.0, 0.3 if condition == "plain" else 0.3 - lost, condition)
        yield evaluation(RETRIEVAL, 3.0, 0.2, condition)
    yield from (evaluation("ours", 2.0, 0.3, n=n) for n in COUNTS if n != 10_000)
    yield evaluation(ORACLE, 2.5, 0.35)
    yield evaluation(ELLIPSOID, 3.5, 0.25)


def test_comparison_method_with_decoder_has_costs() -> None:
    lines = tables.comparison(list(everything()), {"ours": Decoder(7_171, 2, 1.5)}).splitlines()
    assert [line.split(" | ")[0] for line in lines[2:]] == ["| ours", f"| {RETRIEVAL}", f"| {ORACLE}", f"| {ELLIPSOID}"]
    assert lines[2].endswith("| 7,171 | 2 | 1.50 |")
    assert lines[3].endswith("| - | - | - |")
    assert "2.000 (1.9" in lines[2]


def test_differences_interval_without_zero_is_bold() -> None:
    evaluations = [evaluation("ours", 2.0, 0.3), evaluation("same", 2.0, 0.3), evaluation("worse", 2.5, 0.3)]
    same, worse = tables.differences(evaluations, "ours").splitlines()[2:]
    assert "**" not in same
    assert worse.count("**") == 2 * 3
    assert "**-0.500 (-0.500 to -0.500)**" in worse


def test_per_class_classes_are_sorted_with_both_means() -> None:
    lines = tables.per_class(list(everything()), ["ours", ORACLE], CLASSES).splitlines()
    assert [line.split(" | ")[0].strip("| ") for line in lines[2:]] == [
        "chair",
        "bed",
        "other",
        "**class-uniform**",
        "**class-weighted**",
    ]
    assert [line.split(" | ")[1] for line in lines[2:]] == ["10", "5", "5", "20", "20"]
    assert "0.300 (" in lines[-1]


def test_by_count_and_by_condition_have_a_row_each() -> None:
    evaluations = list(everything(lost=0.06))
    assert [line.split(" | ")[0] for line in tables.by_count(evaluations, "ours").splitlines()[2:]] == [
        "| 1,000",
        "| 10,000",
        "| 100,000",
    ]
    lines = tables.by_condition(evaluations, ["ours", RETRIEVAL]).splitlines()[2:]
    assert len(lines) == 2 * len(CONDITIONS)
    assert lines[0].endswith("| 0.0% |")
    assert lines[2].endswith("| 20.0% |")
    assert tables.loss(evaluations, "ours", "gray") == pytest.approx(20)


def test_find_missing_evaluation_is_named() -> None:
    with pytest.raises(ValueError, match="no evaluation of ours, gray, 10000 points"):
        tables.find([], "ours", "gray")


def test_checks_better_and_worse_figures_follow_the_numbers() -> None:
    met = {check.target: check.met for check in checks(list(everything()), "ours", CLASSES, 19_000_000, 14.9)}
    assert [target for target, is_met in met.items() if not is_met] == [
        "f@1% at least the oracle's, mean over objects",
        "f@1% at least the oracle's, class-uniform",
    ]
    worse = checks(list(everything(lost=0.06)), "ours", CLASSES, 30_000_001, 25.1)
    failed = {check.target for check in worse if not check.met}
    assert {target for target in met if "loses at most" in target} < failed
    assert {"photograph: loses at most 6% of f@2%", "gray: loses at most 15% of f@2%"} < failed
    assert {"encoder at most 30 MB on disk", "encoder at most 25 ms on one core"} < failed
    assert target_table(worse).count("**no**") == len(failed)


def test_checks_class_no_better_than_ellipsoids_is_not_met() -> None:
    evaluations = [one for one in everything() if one.method != ELLIPSOID]
    ellipsoid = evaluation("ours", 2.0, 0.3)
    ellipsoid.figures["f@2%"] -= np.where(np.array(CLASSES) == "bed", 0, 0.1)
    judged = {
        check.target: check.met
        for check in checks([*evaluations, replace(ellipsoid, method=ELLIPSOID)], "ours", CLASSES, 1, 1.0)
    }
    assert not judged["bed: f@2% above the moment-matched ellipsoid's"]
    assert judged["chair: f@2% above the moment-matched ellipsoid's"]
    assert judged["objects no better in f@2% than their ellipsoids: at most 8"]  # the beds alone


def test_checks_many_objects_no_better_than_their_ellipsoids_is_not_met() -> None:
    evaluations = [one for one in everything() if one.method != ELLIPSOID]
    alike = replace(evaluation("ours", 2.0, 0.3), method=ELLIPSOID)
    judged = {check.target: check.met for check in checks([*evaluations, alike], "ours", CLASSES, 1, 1.0)}
    assert not judged["objects no better in f@2% than their ellipsoids: at most 8"]


def test_checks_gain_within_the_interval_is_not_met() -> None:
    evaluations = [one for one in everything() if one.method != RETRIEVAL]
    noise = np.random.default_rng(5).normal(0, 1, len(CLASSES))
    for condition in CONDITIONS:
        ours = evaluation("ours", 2.0, 0.3)
        evaluations.append(Evaluation(RETRIEVAL, {name: ours.column(name) + noise for name in NAMES}, condition))
    unclear = [check for check in checks(evaluations, "ours", CLASSES, 1, 1.0) if "retrieval" in check.target]
    assert len(unclear) == 5 * len(CONDITIONS)
    assert not any(check.met for check in unclear)
