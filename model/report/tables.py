"""The tables of RESULTS.md, each a function of evaluations alone."""

from collections.abc import Mapping, Sequence

import numpy as np

from model.evaluation.classes import EVERYDAY, OTHER
from model.evaluation.comparison import COUNTS
from model.evaluation.conditions import CONDITIONS, Condition
from model.evaluation.evaluate import PREDICTED_POINTS, Evaluation
from model.evaluation.records import Decoder
from model.metrics import NAMES, Values, class_uniform, interval


def find(
    evaluations: Sequence[Evaluation], method: str, condition: Condition = "plain", n: int = PREDICTED_POINTS
) -> Evaluation:
    """Return the evaluation of a method under a condition with n points.

    Raises
    ------
    ValueError : it is missing.
    """
    for evaluation in evaluations:
        if (evaluation.method, evaluation.condition, evaluation.n) == (method, condition, n):
            return evaluation
    raise ValueError(f"no evaluation of {method}, {condition}, {n} points")


def comparison(evaluations: Sequence[Evaluation], decoders: dict[str, Decoder]) -> str:
    """Return the table of all methods on plain images: metrics with intervals, cost of the decoder (paper, table 1)."""
    rows = []
    for evaluation in evaluations:
        if evaluation.condition == "plain" and evaluation.n == PREDICTED_POINTS:
            decoder = decoders.get(evaluation.method)
            cost = [f"{decoder.parameters:,}", str(decoder.layers), f"{decoder.ms:.2f}"] if decoder else ["-"] * 3
            rows.append([evaluation.method, *(spread(interval(evaluation.column(name))) for name in NAMES), *cost])
    return table(["method", *NAMES, "decoder parameters", "layers", "ms per 10,000 points"], rows)


def differences(evaluations: Sequence[Evaluation], method: str) -> str:
    """Return the table of a method minus each other one, with paired intervals over objects, bold if they exclude 0."""
    ours = find(evaluations, method)
    rows = []
    for other in evaluations:
        if other.method != method and other.condition == "plain" and other.n == PREDICTED_POINTS:
            gaps = [interval(ours.column(name) - other.column(name)) for name in NAMES]
            marked = [spread(gap, "+") for gap in gaps]
            bold = [f"**{cell}**" if gap[1] > 0 or gap[2] < 0 else cell for cell, gap in zip(marked, gaps, strict=True)]
            rows.append([other.method, *bold])
    return table([f"{method} minus", *NAMES], rows)


def per_class(evaluations: Sequence[Evaluation], methods: Sequence[str], classes: Sequence[str]) -> str:
    """Return the table of summed cd_epcg, F@1% and F@2% of methods by class, then both means over all objects."""
    chosen = [find(evaluations, method) for method in methods]
    columns = [sum_directions(evaluation) for evaluation in chosen]
    columns += [evaluation.column(name) for name in ("f@1%", "f@2%") for evaluation in chosen]
    heads = [f"{metric}, {method}" for metric in ("cd sum", "f@1%", "f@2%") for method in methods]
    return by_class(dict(zip(heads, columns, strict=True)), classes)


def by_class(columns: Mapping[str, Values], classes: Sequence[str]) -> str:
    """Return the table of means by class of columns (objects,), then both means over all objects."""
    labels, count = np.array(classes), str(len(classes))
    rows = []
    for name in _sort(classes):
        here = labels == name
        rows.append([name, str(here.sum()), *(f"{column[here].mean():.3f}" for column in columns.values())])
    rows.append(["**class-uniform**", count, *(spread(class_uniform(each, classes)) for each in columns.values())])
    rows.append(["**class-weighted**", count, *(spread(interval(column)) for column in columns.values())])
    return table(["class", "objects", *columns], rows)


def by_count(evaluations: Sequence[Evaluation], method: str) -> str:
    """Return the table of a method's metrics at each count of predicted points."""
    rows = [
        [f"{n:,}", *(spread(interval(find(evaluations, method, n=n).column(name))) for name in NAMES)] for n in COUNTS
    ]
    return table(["predicted points", *NAMES], rows)


def by_condition(evaluations: Sequence[Evaluation], methods: Sequence[str]) -> str:
    """Return the table of methods under every condition, with the loss of F@2% against plain images."""
    rows = []
    for condition in CONDITIONS:
        for method in methods:
            evaluation = find(evaluations, method, condition)
            figures = [spread(interval(evaluation.column(name))) for name in NAMES]
            rows.append([condition, method, *figures, f"{loss(evaluations, method, condition):.1f}%"])
    return table(["images", "method", *NAMES, "loss of f@2%"], rows)


def loss(evaluations: Sequence[Evaluation], method: str, condition: Condition) -> float:
    """Return the loss of a method's F@2% under a condition, in % of its mean on plain images."""
    plain, hard = (float(find(evaluations, method, which).column("f@2%").mean()) for which in ("plain", condition))
    return 100 * (1 - hard / plain) if plain else 0.0


def card_table(evaluations: Sequence[Evaluation]) -> str:
    """Return the table of methods by metrics, with mean and 95% bootstrap interval over objects."""
    return table(
        ["method", *NAMES],
        [[each.method, *(spread(interval(each.column(name))) for name in NAMES)] for each in evaluations],
    )


def sum_directions(evaluation: Evaluation) -> Values:
    """Return cd_epcg, both directions summed, (objects,)."""
    total: Values = evaluation.column("cd_forward") + evaluation.column("cd_backward")
    return total


def spread(figures: tuple[float, float, float], sign: str = "") -> str:
    """Format a mean and its interval as a cell."""
    mean, low, high = figures
    return f"{mean:{sign}.3f} ({low:{sign}.3f} to {high:{sign}.3f})"


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _sort(classes: Sequence[str]) -> list[str]:
    """Sort classes: everyday furniture first, then the others by name, OTHER last."""
    present = set(classes)
    first = [name for name in EVERYDAY if name in present]
    return [*first, *sorted(present - {*EVERYDAY, OTHER}), *({OTHER} & present)]
