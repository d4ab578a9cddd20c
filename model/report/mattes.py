"""Write the section of RESULTS.md on mattes."""

from pathlib import Path

import numpy as np

from model.evaluation.locations import MATTES
from model.evaluation.mattes import TRUE_MASKS, MatteTrials, Outcome
from model.report.tables import table

POOR = 0.7  # an overlap below it


def section(root: Path) -> str:
    """Return the section; empty without a record."""
    path = root / MATTES
    if not path.exists():
        return ""
    trials = MatteTrials.read(path)
    origin = trials.origin
    bounds = {each.zoom: _score(each) for each in trials.outcomes if each.way == TRUE_MASKS}
    head = ["object's share of the side", "way", "overlap, mean", f"below {POOR}", "refused", "f@1%", "f@2%"]
    rows = [_row(each, bounds[each.zoom]) for each in trials.outcomes]
    return f"""## Mattes

Written by `hof-model mattes`, {origin["date"]}, commit {origin["commit"]}: {origin["objects"]} objects of the
{origin["split"]} split, four views each, somewhere in front of photographs that no training saw. The overlap is the
intersection over union of the mask found and the true one. Where the service refuses a picture, it counts as the whole
picture. F-scores are of the object that `{origin["model"]}` draws from what the mask leaves.

{table([*head, "loss of f@2%"], rows)}"""


def _row(each: Outcome, bound: float) -> list[str]:
    overlaps = np.array(each.overlaps)
    masks = [f"{overlaps.mean():.3f}", f"{(overlaps < POOR).mean():.1%}"] if len(overlaps) else ["-", "-"]
    refused = str(each.refused) if len(overlaps) else "-"
    scores = [f"{np.mean(values):.3f}" for values in each.scores.values()]
    return [f"{each.zoom:.2f}", each.way, *masks, refused, *scores, f"{1 - _score(each) / bound:.1%}"]


def _score(each: Outcome) -> float:
    return float(np.mean(each.scores["f@2%"]))
