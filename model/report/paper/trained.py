"""Write the section of PAPER.md on an experiment that trains: a row for each variant, a verdict on each claim."""

from typing import Any, Final

import numpy as np

from model.evaluation.locations import PAPER
from model.evaluation.paper.record import PaperRecord
from model.evaluation.paper.suites import PICTURED, Claim, Suite
from model.metrics import interval
from model.report.tables import spread, table

FIGURES: Final = ("cd_forward", "cd_backward", "f@1%", "f@2%", "f@5%")
CLOSE: Final = 0.05  # of the base's figure: farther away is another quality
FLAT: Final = 0.25  # last share of a run in which its curve should not rise any more


def section(suite: Suite, record: PaperRecord) -> str:
    """Return the section: setting, table, the paper's figures, the curves' ends, verdicts."""
    setting, origin = record.setting, record.origin
    about = setting["variants"]
    first = next(iter(about.values()))
    budgets = sorted({(each["steps"], each["batch"]) for each in about.values()})
    steps = ", ".join(f"{count:,} steps of {batch} images" for count, batch in budgets)
    views = "all views, all true points" if setting["every_view"] else "4 views, 10,000 true points"
    seeds = ", ".join(map(str, setting["seeds"]))
    return f"""## {suite.title}

{suite.text} Written by `hof-model paper {record.experiment}`: {steps}, image encoder {first["trunk"]} unless a row says
otherwise, {setting["split"]} split, {setting["objects"]} objects, {views}, {setting["points"]:,} points a cloud, seeds
{seeds}; {origin["machine"]}, {origin["date"]}, commit {origin["commit"]}.

{_figures(record)}

{_paper(suite)}{_curves(about)}{_picture(record)}

The paper's claims, on the mean of both distances; differences are paired over objects. As good as means within
{CLOSE:.0%}:

{chr(10).join(f"- {claim.text}: {verdict(record, claim)}." for claim in suite.claims)}"""


def _figures(record: PaperRecord) -> str:
    rows = []
    extra = [name for name in ("travel",) if any(name in trial.figures for trial in record.trials)]
    for trial in record.trials:
        about = record.setting["variants"][trial.method]
        cells = [spread(interval(trial.column(name))) for name in FIGURES]
        cells += [spread(interval(trial.column(name))) if name in trial.figures else "-" for name in extra]
        of_image = about["predicted"]
        share = f"{of_image:,}" if of_image else "-"
        rows.append([trial.method, *cells, f"{about['parameters']:,}", share, str(about["layers"])])
    columns = ["variant", "CD(P,T)", "CD(T,P)", "F@1%", "F@2%", "F@5%", *extra, "decoder parameters"]
    return table([*columns, "of these from the image", "layers"], rows)


def _paper(suite: Suite) -> str:
    if not suite.paper:
        return ""
    rows = [[name, f"{ahead:.3f}", f"{back:.3f}"] for name, (ahead, back) in suite.paper.items()]
    return f"""The paper's figures (ShapeNet, another scale):

{table(["variant", "CD(P,T)", "CD(T,P)"], rows)}

"""


def _picture(record: PaperRecord) -> str:
    if record.experiment != PICTURED:
        return ""
    return f"""

Slices of the ball in red, and where they land in green:

![slices of the ball, and where they land]({PAPER}/{PICTURED}.png)"""


def _curves(about: dict[str, Any]) -> str:
    """Return how much the validation still gained at the end of each run."""
    parts = []
    for name, each in about.items():
        curve = each["curve"]
        late = [value for step, value in curve if step >= (1 - FLAT) * each["steps"]]
        parts.append(f"{name} {late[-1] - late[0]:+.4f}" if len(late) > 1 else f"{name} not known")
    return f"F@1% that validation gained over the last quarter of each run: {'; '.join(parts)}."


def verdict(record: PaperRecord, claim: Claim) -> str:
    """Return whether a claim holds, with the paired difference of its figure and the interval."""
    chosen = np.array([not claim.classes or each in claim.classes for each in record.classes])
    if not chosen.any():
        return "not measured, the split has no such objects"
    one, other = (record.trial(name).column(claim.figure)[chosen] for name in (claim.one, claim.other))
    gap = interval(one - other)
    base = float(np.mean(other))
    relative = "" if not base else f", {gap[0] / base:+.1%}"
    shown = f"{spread(gap, '+')}{relative}"
    if claim.kind == "lower":
        return f"{'holds' if gap[2] < 0 else 'does not hold' if gap[1] > 0 else 'undecided'}, {shown}"
    margin = CLOSE * base
    if gap[1] > -margin and gap[2] < margin:
        return f"holds, {shown}"
    if gap[1] > margin:
        return f"does not hold, it is worse: {shown}"
    if gap[2] < -margin:
        return f"better than that, {shown}"
    return f"undecided, {shown}"
