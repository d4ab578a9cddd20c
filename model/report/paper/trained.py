"""Write the section of PAPER.md on an experiment that trains: a row for each variant, a verdict on each claim."""

import textwrap
from typing import Any, Final

import numpy as np

from model.evaluation.locations import PAPER
from model.evaluation.paper.record import PaperRecord
from model.evaluation.paper.suites import CD, PICTURED, Claim, Suite
from model.metrics import class_uniform, interval
from model.report.tables import by_class, spread, table

FIGURES: Final = ("cd_forward", "cd_backward", "f@1%", "f@2%", "f@5%")
HEADS: Final = ("CD(P,T)", "CD(T,P)", "F@1%", "F@2%", "F@5%")
CLOSE: Final = 0.05  # of the base's figure: farther away is another quality
WIDTH: Final = 120  # of a line of text
QUARTERS: Final = (0.25, 0.5, 0.75, 1.0)


def section(suite: Suite, record: PaperRecord) -> str:
    """Return the section: setting, table, the paper's figures, the curves' ends, verdicts."""
    setting, origin = record.setting, record.origin
    about = setting["variants"]
    first = next(iter(about.values()))
    budgets = sorted({(each["steps"], each["batch"]) for each in about.values()})
    steps = ", ".join(f"{count:,} steps of {batch} images" for count, batch in budgets)
    views = "all views, all true points" if setting["every_view"] else "4 views, 10,000 true points"
    seeds = ", ".join(map(str, setting["seeds"]))
    images = f"{first['size']} pixels a side{'' if first['augmented'] else ', not augmented'}"
    intro = (
        f"{suite.text} Written by `hof-model paper {record.experiment}`: {steps} of {images}, image encoder "
        f"{first['trunk']} unless a row says otherwise, {setting['split']} split, {setting['objects']} objects, "
        f"{views}, {setting['points']:,} points a cloud, seeds {seeds}; {origin['machine']}, {origin['date']}, commit "
        f"{origin['commit']}."
    )
    claims = (
        "The paper's claims, on the mean of both distances; differences are paired over objects. As good as means "
        f"within {CLOSE:.0%}.{_seeds(setting['seeds'])}"
    )
    return f"""## {suite.title}

{textwrap.fill(intro, WIDTH, break_on_hyphens=False)}

{_figures(record)}

{_by_class(record) if suite.is_by_class else ""}{_paper(suite)}{_curves(about)}{_picture(record)}

{textwrap.fill(claims, WIDTH, break_on_hyphens=False)}

{chr(10).join(f"- {claim.text}: {verdict(record, claim)}." for claim in suite.claims)}"""


def _figures(record: PaperRecord) -> str:
    rows = []
    extra = [name for name in ("travel",) if any(name in trial.figures for trial in record.trials)]
    for trial in record.trials:
        cells = [spread(interval(trial.column(name))) for name in FIGURES]
        cells += [spread(interval(trial.column(name))) if name in trial.figures else "-" for name in extra]
        about = record.setting["variants"].get(trial.method, {})  # none of a method that is not trained
        numbers = [about.get("parameters"), about.get("predicted"), about.get("layers")]
        rows.append([trial.method, *cells, *(f"{number:,}" if number else "-" for number in numbers)])
    head = ["variant", *HEADS, *extra, "decoder parameters", "of these from the image", "layers"]
    return table(head, rows)


def _seeds(seeds: list[int]) -> str:
    """Return what the intervals do not tell if each network was trained once."""
    if len(seeds) > 1:
        return ""
    return " Each network was trained once: the intervals do not tell how much another seed would change."


def _by_class(record: PaperRecord) -> str:
    """Return the class-uniform means of all figures, and two figures by class."""
    rows = [
        [trial.method, *(spread(class_uniform(trial.column(name), record.classes)) for name in FIGURES)]
        for trial in record.trials
    ]
    parts = [f"Class-uniform means, every class counting equally:\n\n{table(['variant', *HEADS], rows)}"]
    for title, name in (("Mean of both distances", CD), ("F@1%", "f@1%")):
        columns = {trial.method: trial.column(name) for trial in record.trials}
        parts.append(f"{title} by class:\n\n{by_class(columns, record.classes)}")
    return "\n\n".join(parts) + "\n\n"


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
    """Return the validation's F@1% after each quarter of each run, and what it gained in the last one."""
    rows = []
    for name, each in about.items():
        reached = [[value for step, value in each["curve"] if step <= share * each["steps"]] for share in QUARTERS]
        late = [value for step, value in each["curve"] if step >= QUARTERS[-2] * each["steps"]]
        gain = f"{late[-1] - late[0]:+.4f}" if len(late) > 1 else "-"
        rows.append([name, *(f"{values[-1]:.4f}" if values else "-" for values in reached), gain])
    head = ["variant", *(f"{share:.0%} of the steps" for share in QUARTERS), "gained in the last quarter"]
    return f"F@1% on the validation split, whose curve is flat where the last gain is near 0:\n\n{table(head, rows)}"


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
