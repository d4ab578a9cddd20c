"""The tables of RESULTS.md, each a function of evaluations alone."""

from collections.abc import Sequence

import numpy as np

from model.evaluation.classes import EVERYDAY, OTHER
from model.evaluation.comparison import COUNTS
from model.evaluation.conditions import CONDITIONS, Condition
from model.evaluation.evaluate import POINTS, Evaluation
from model.evaluation.records import Decoder
from model.metrics import NAMES, Values, class_uniform, interval


def find(evaluations: Sequence[Evaluation], method: str, condition: Condition = "plain", n: int = POINTS) -> Evaluation:
    """The one evaluation of a method under a condition. Raises ValueError where it is missing."""
    for found in evaluations:
        if (found.method, found.condition, found.n) == (method, condition, n):
            return found
    raise ValueError(f"no evaluation of {method}, {condition}, {n} points")


def comparison(evaluations: Sequence[Evaluation], decoders: dict[str, Decoder]) -> str:
    """Every method on plain images: metrics with intervals, and what its decoder costs (paper, table 1)."""
    rows = []
    for found in evaluations:
        if found.condition == "plain" and found.n == POINTS:
            decoder = decoders.get(found.method)
            cost = [f"{decoder.parameters:,}", str(decoder.layers), f"{decoder.ms:.2f}"] if decoder else ["-"] * 3
            rows.append([found.method, *(spread(interval(found.column(name))) for name in NAMES), *cost])
    return table(["method", *NAMES, "decoder parameters", "layers", "ms per 10,000 points"], rows)


def differences(evaluations: Sequence[Evaluation], method: str) -> str:
    """The method minus each other one, object by object, with the paired interval; bold where it excludes 0."""
    ours = find(evaluations, method)
    rows = []
    for other in evaluations:
        if other.method != method and other.condition == "plain" and other.n == POINTS:
            gaps = [interval(ours.column(name) - other.column(name)) for name in NAMES]
            marked = [spread(gap, "+") for gap in gaps]
            bold = [f"**{cell}**" if gap[1] > 0 or gap[2] < 0 else cell for cell, gap in zip(marked, gaps, strict=True)]
            rows.append([other.method, *bold])
    return table([f"{method} minus", *NAMES], rows)


def per_class(evaluations: Sequence[Evaluation], methods: Sequence[str], classes: Sequence[str]) -> str:
    """Summed cd_epcg, F@1% and F@2% of methods by class, then both means over all objects."""
    found = [find(evaluations, method) for method in methods]
    columns = [summed(evaluation) for evaluation in found]
    columns += [evaluation.column(name) for name in ("f@1%", "f@2%") for evaluation in found]
    labels = np.array(classes)
    rows = []
    for name in _ordered(classes):
        here = labels == name
        rows.append([name, str(here.sum()), *(f"{column[here].mean():.3f}" for column in columns)])
    count = str(len(classes))
    rows.append(["**class-uniform**", count, *(spread(class_uniform(column, classes)) for column in columns)])
    rows.append(["**class-weighted**", count, *(spread(interval(column)) for column in columns)])
    head = [f"{what}, {method}" for what in ("cd sum", "f@1%", "f@2%") for method in methods]
    return table(["class", "objects", *head], rows)


def by_count(evaluations: Sequence[Evaluation], method: str) -> str:
    """The method's metrics at each count of predicted points."""
    rows = [
        [f"{n:,}", *(spread(interval(find(evaluations, method, n=n).column(name))) for name in NAMES)] for n in COUNTS
    ]
    return table(["predicted points", *NAMES], rows)


def by_condition(evaluations: Sequence[Evaluation], methods: Sequence[str]) -> str:
    """Methods under every condition, and what of F@2% each loses against plain images."""
    rows = []
    for condition in CONDITIONS:
        for method in methods:
            found = find(evaluations, method, condition)
            figures = [spread(interval(found.column(name))) for name in NAMES]
            rows.append([condition, method, *figures, f"{loss(evaluations, method, condition):.1f}%"])
    return table(["images", "method", *NAMES, "loss of f@2%"], rows)


def loss(evaluations: Sequence[Evaluation], method: str, condition: Condition) -> float:
    """What a method loses of its F@2% under a condition, in % of the plain images' mean."""
    plain, hard = (float(find(evaluations, method, which).column("f@2%").mean()) for which in ("plain", condition))
    return 100 * (1 - hard / plain) if plain else 0.0


def card_table(evaluations: Sequence[Evaluation]) -> str:
    """Methods by metrics, mean and 95% bootstrap interval over objects."""
    return table(
        ["method", *NAMES],
        [[found.method, *(spread(interval(found.column(name))) for name in NAMES)] for found in evaluations],
    )


def summed(evaluation: Evaluation) -> Values:
    """cd_epcg of both directions together, (objects,)."""
    total: Values = evaluation.column("cd_forward") + evaluation.column("cd_backward")
    return total


def spread(figures: tuple[float, float, float], sign: str = "") -> str:
    """A mean and its interval in a cell."""
    mean, low, high = figures
    return f"{mean:{sign}.3f} ({low:{sign}.3f} to {high:{sign}.3f})"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _ordered(classes: Sequence[str]) -> list[str]:
    """Everyday furniture first, then the others by name, OTHER last."""
    present = set(classes)
    first = [name for name in EVERYDAY if name in present]
    return [*first, *sorted(present - {*EVERYDAY, OTHER}), *({OTHER} & present)]
