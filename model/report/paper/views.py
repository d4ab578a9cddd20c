"""Write the section of PAPER.md on several views of one object."""

from typing import Final

from model.evaluation.paper.record import PaperRecord
from model.evaluation.paper.views import CODES, COMPOSED, COUNTS, MEDOID, ONE, THETAS, UNION, trial_name
from model.metrics import interval
from model.report.tables import spread, table

METHODS: Final = (COMPOSED, THETAS, CODES, MEDOID, UNION)
SERVED: Final = (THETAS, MEDOID)  # one function for any count of views, which the service can keep as an object
METRICS: Final = ("f@1%", "f@2%", "f@5%")


def section(record: PaperRecord) -> str:
    """Return the section: setting, a table for each metric, what follows for the service."""
    setting, origin = record.setting, record.origin
    tables = "\n\n".join(f"{metric.upper()}:\n\n{_table(record, metric)}" for metric in METRICS)
    return f"""## Several views of one object

One shape from several photos of one object. Written by `hof-model paper views`: `{origin["model"]}`,
{setting["split"]} split, {setting["objects"]} objects, {setting["points"]:,} points a cloud, views
{", ".join(map(str, setting["views"]))} of 24 around the object, seed {origin["seed"]}; {origin["machine"]},
{origin["date"]}, commit {origin["commit"]}.

- Each count of views is measured on all sets of that many views in even steps around the object, so every count uses
  the same photos; figures are means over the sets. Intervals are 95% bootstrap intervals over objects.
- *{COMPOSED}*: each word is the functions of {origin["k"]} neighboring views, and all words share the points evenly.
- *{CODES}*: of the tensor before the encoder's last layer. That layer is linear, so this is the mean of thetas; the
  largest difference of a weight is {setting["gap"]:.1e}.
- *{MEDOID}*: one view is chosen, the others are dropped.
- *{UNION}*: each view's own function draws an equal share of the points.

{tables}

{_verdict(record)}"""


def _table(record: PaperRecord, metric: str) -> str:
    one = spread(interval(record.trial(ONE).column(metric)))
    rows = [[ONE, one, *["-"] * (len(COUNTS) - 1)]]
    for method in METHODS:
        cells = [spread(interval(record.trial(trial_name(method, count)).column(metric))) for count in COUNTS[1:]]
        rows.append([method, "-", *cells])
    return table(["aggregated by", *(f"{count} view{'s' * (count > 1)}" for count in COUNTS)], rows)


def _verdict(record: PaperRecord) -> str:
    """Return each way's paired difference to one view, and the way that is best where the service can use it."""
    metric = METRICS[0]
    lines = []
    for method in METHODS:
        gaps = [_gap(record, trial_name(method, count), ONE, metric) for count in COUNTS[1:]]
        shown = ", ".join(f"{spread(gap, '+')} for {count}" for count, gap in zip(COUNTS[1:], gaps, strict=True))
        lines.append(f"- {method}: {shown} views.")
    best = winner(record)
    rest = [trial_name(method, count) for method in (*SERVED, COMPOSED) if method != best for count in COUNTS[1:]]
    others = [f"- {name}: {spread(_gap(record, _like(best, name), name, metric), '+')}." for name in rest]
    return f"""{metric.upper()} minus that of one view, paired over objects (the paper does not aggregate views):

{chr(10).join(lines)}

Of the ways that give one function for any count of views, *{best}* is best over all counts: `POST /compose`
with `mode=interpolate` makes it of stored objects. (Words of more than {record.origin["k"]} views are several objects.)
Its {metric.upper()} minus that of:

{chr(10).join(others)}"""


def _like(method: str, name: str) -> str:
    """Return the trial of a method with the count of views that another trial's name tells."""
    return f"{method},{name.rpartition(',')[2]}"


def winner(record: PaperRecord) -> str:
    """Return the way that the service can use with the best mean F@1% over all counts of several views."""
    metric = METRICS[0]

    def score(method: str) -> float:
        return sum(float(record.trial(trial_name(method, count)).column(metric).mean()) for count in COUNTS[1:])

    return max(SERVED, key=score)


def _gap(record: PaperRecord, method: str, other: str, metric: str) -> tuple[float, float, float]:
    return interval(record.trial(method).column(metric) - record.trial(other).column(metric))
