"""Targets of the shipped model against its measurements, computed."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from model.evaluation.classes import EVERYDAY
from model.evaluation.comparison import ELLIPSOID, ORACLE, RETRIEVAL
from model.evaluation.conditions import CONDITIONS, Condition
from model.evaluation.evaluate import Evaluation
from model.metrics import class_uniform, interval
from model.report.tables import find, loss, spread, table

BETTER: Final = {"cd_forward": -1, "cd_backward": -1, "f@1%": 1, "f@2%": 1, "f@5%": 1}  # the sign of a gain
MOST_LOST: Final[dict[Condition, float]] = {"photograph": 6.0}  # % of F@2%
OTHERWISE_LOST: Final = 15.0  # on other harder images
MOST_BEATEN: Final = 8  # objects no better than their ellipsoids
MOST_BYTES: Final = 30_000_000
MOST_MS: Final = 25.0


@dataclass(frozen=True)
class Check:
    """A target, its measurement, and whether it is met."""

    target: str
    measured: str
    met: bool


def checks(
    evaluations: Sequence[Evaluation], method: str, classes: Sequence[str], bytes_: int, ms: float
) -> list[Check]:
    """Check every target of the shipped model; `bytes_` and `ms` are the encoder's size and time per image."""
    ours, oracle = find(evaluations, method), find(evaluations, ORACLE)
    results = list(_retrieval_checks(evaluations, method, "plain"))
    for name in ("cd_forward", "cd_backward"):
        a, b = float(ours.column(name).mean()), float(oracle.column(name).mean())
        results.append(Check(f"{name} below the oracle's", f"{a:.3f} against {b:.3f}", a < b))
    means = [one.column("f@1%") for one in (ours, oracle)]
    for weights, (a, b) in (
        ("mean over objects", [float(values.mean()) for values in means]),
        ("class-uniform", [class_uniform(values, classes)[0] for values in means]),
    ):
        results.append(Check(f"f@1% at least the oracle's, {weights}", f"{a:.3f} against {b:.3f}", a >= b))
    results += _ellipsoid_checks(ours, find(evaluations, ELLIPSOID), classes)
    for condition in CONDITIONS[1:]:
        results += _retrieval_checks(evaluations, method, condition)
        lost = loss(evaluations, method, condition)
        most = MOST_LOST.get(condition, OTHERWISE_LOST)
        results.append(Check(f"{condition}: loses at most {most:g}% of f@2%", f"{lost:.1f}%", lost <= most))
    results.append(Check("encoder at most 30 MB on disk", f"{bytes_ / 1e6:.1f} MB", bytes_ <= MOST_BYTES))
    results.append(Check("encoder at most 25 ms on one core", f"{ms:.1f} ms", ms <= MOST_MS))
    return results


def target_table(results: Sequence[Check]) -> str:
    """Return the checks as a Markdown table."""
    rows = [[check.target, check.measured, "yes" if check.met else "**no**"] for check in results]
    return table(["target", "measured", "met"], rows)


def _ellipsoid_checks(ours: Evaluation, ellipsoid: Evaluation, classes: Sequence[str]) -> Iterator[Check]:
    """Check that few objects are no better than their moment-matched ellipsoids, and each class of furniture is."""
    beaten = int((ours.column("f@2%") <= ellipsoid.column("f@2%")).sum())
    text = f"objects no better in f@2% than their ellipsoids: at most {MOST_BEATEN}"
    yield Check(text, str(beaten), beaten <= MOST_BEATEN)
    labels = np.array(classes)
    for name in (name for name in EVERYDAY if name in classes):
        a, b = (float(one.column("f@2%")[labels == name].mean()) for one in (ours, ellipsoid))
        yield Check(f"{name}: f@2% above the moment-matched ellipsoid's", f"{a:.3f} against {b:.3f}", a > b)


def _retrieval_checks(evaluations: Sequence[Evaluation], method: str, condition: Condition) -> Iterator[Check]:
    """Check that each metric beats image retrieval: the paired interval excludes 0 on the better side."""
    ours, other = find(evaluations, method, condition), find(evaluations, RETRIEVAL, condition)
    for name, sign in BETTER.items():
        gap = interval(ours.column(name) - other.column(name))
        met = bool(np.min([sign * gap[1], sign * gap[2]]) > 0)
        yield Check(f"{condition}: {name} better than image retrieval's", f"by {spread(gap, '+')}", met)
