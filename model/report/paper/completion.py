"""Write the section of PAPER.md on objects that are completed from points."""

from typing import Final

from model.evaluation.locations import PAPER
from model.evaluation.paper.completion import ALONE, COMPLETED, COUNTS, ENCODED, EXPERIMENT, SHARES, trial_name
from model.evaluation.paper.record import PaperRecord
from model.metrics import interval
from model.report.tables import spread, table

METRICS: Final = ("f@1%", "f@2%", "f@5%", "cd_forward", "cd_backward")


def section(record: PaperRecord) -> str:
    """Return the section: setting, a table by share seen, a table by number of points."""
    setting, origin = record.setting, record.origin
    by_share = [(f"{share:.0%}", share, COUNTS[-1]) for share in SHARES]
    by_count = [(f"{count:,}", SHARES[1], count) for count in COUNTS]
    return f"""## Points of a part of an object

The whole object from points of a part of its surface. Written by `hof-model paper points`: `{origin["model"]}`,
{setting["split"]} split, {setting["objects"]} objects, {setting["points"]:,} points a cloud, seed {origin["seed"]};
{origin["machine"]}, {origin["date"]}, commit {origin["commit"]}.

- A part is the share of the true points on one side of a random plane. It is centered and scaled by its own box, and
  the answer is compared in the part's place; distances are in longest sides of the whole object.
- *{COMPLETED}*: as the service does it: encoded with the front on each of eight sides, the best object fitted to the
  part. *{ENCODED}*: without the fit.
- *{ALONE}*: the points of the part as the answer: fewer than those of the completed object, all of them on the surface.

By share of the surface, {COUNTS[-1]:,} points:

{_table(record, "share", by_share)}

By number of points, {SHARES[1]:.0%} of the surface:

{_table(record, "points", by_count)}

The first objects, from half of the surface:

![parts, completed objects, true objects]({PAPER}/{EXPERIMENT}.png)"""


def _table(record: PaperRecord, heading: str, rows: list[tuple[str, float, int]]) -> str:
    lines = [
        [f"{label}, {method}", *(spread(interval(trial.column(metric))) for metric in METRICS)]
        for label, share, count in rows
        for method in (COMPLETED, ENCODED, ALONE)
        for trial in [record.trial(trial_name(method, share, count))]
    ]
    return table([heading, *METRICS], lines)
