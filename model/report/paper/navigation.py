"""Write the section of PAPER.md on collision-free paths."""

from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from model.evaluation.comparison import RETRIEVAL
from model.evaluation.paper.navigation import SABB, SHORTEST_L1
from model.evaluation.paper.record import PaperRecord, Trial, Values
from model.metrics import interval
from model.report.tables import spread, table

# Mitchell et al. 2020, table of path planning: chairs of ShapeNet, mean and deviation.
PAPER: Final = {
    SHORTEST_L1: ("0.341 ± 0.35", "1.0 ± 0.0"),
    SABB: ("1.0 ± 0.0", "0.960 ± 0.05"),
    "direct decoder (EPCG)": ("0.775 ± 0.19", "0.994 ± 0.02"),
    "HOF": ("0.989 ± 0.06", "0.998 ± 0.01"),
}
SUCCESS: Final = 0.989  # of HOF in that table
CHAIR: Final = "chair"
DIRECT: Final = "direct decoder"  # trained ones are named `direct decoder, N steps`
HOF: Final = "HOF-1"

Mask = npt.NDArray[np.bool_]


def section(record: PaperRecord) -> str:
    """Return the section: setting, tables of chairs and of all objects, the paper's table, verdict."""
    setting, origin = record.setting, record.origin
    chairs = np.array(record.classes) == CHAIR
    everything = np.ones_like(chairs)
    paper = table(["method", "success", "optimality"], [[method, *cells] for method, cells in PAPER.items()])
    return f"""## Collision-free paths

A path around the object is planned on a prediction, and checked against the true object. Written by
`hof-model paper paths`: `{origin["model"]}`, {setting["split"]} split, view {setting["view"]} of {setting["objects"]}
objects, {setting["points"]:,} points a cloud, {setting["cells"]}³ cells over [-1, 1]³, {setting["pairs"]} pairs of
start and goal per object on its L1 sphere, seed {origin["seed"]}; {origin["machine"]}, {origin["date"]}, commit
{origin["commit"]}.

- **Success**: share of pairs with a path that meets no cell of the true object's points.
- **Optimality**: length of the shortest free path, divided by the length of the method's; mean over its successes.
- **No path**: share of pairs for which the method found none, because start, goal or the way is blocked.
- Figures are means over objects with their standard deviation, as in the paper, and the 95% bootstrap interval.
- *{SHORTEST_L1}* ignores the object; *{SABB}* goes around the true bounding box. Ties between shortest paths are broken
  at random, and start and goal lie outside that box: the paper states neither.

Chairs ({int(chairs.sum())} objects):

{_methods(record.trials, chairs)}

All objects ({len(chairs)}):

{_methods(record.trials, everything)}

The paper's table (chairs of ShapeNet, another data set):

{paper}

{_verdict(record, chairs)}"""


def _methods(trials: Sequence[Trial], where: Mask) -> str:
    rows = []
    for trial in trials:
        cells = [_cell(trial.column(name)[where]) for name in ("success", "optimality")]
        rows.append([trial.method, *cells, _cell(trial.column("no path")[where])])
    return table(["method", "success", "optimality", "no path"], rows)


def _cell(values: Values) -> str:
    present = values[~np.isnan(values)]
    if not present.size:
        return "-"
    mean, low, high = interval(present)
    return f"{mean:.3f} ± {present.std():.2f} ({low:.3f} to {high:.3f})"


def _verdict(record: PaperRecord, chairs: Mask) -> str:
    """Return a sentence for each claim of the paper; differences are paired, over all objects."""
    model = record.origin["model"]
    ours = record.trial(model)
    claims = [
        f"Success above that of *{SHORTEST_L1}*: {_difference(ours, record.trial(SHORTEST_L1), 'success')}.",
        f"Paths shorter than those of *{SABB}* (optimality): {_difference(ours, record.trial(SABB), 'optimality')}.",
        _against_direct(record, ours),
        f"Not in the paper: success above that of {RETRIEVAL}: "
        f"{_difference(ours, record.trial(RETRIEVAL), 'success')}.",
    ]
    if chairs.any():
        success = interval(ours.column("success")[chairs])
        reached = "reached" if success[2] >= SUCCESS else "not reached"
        claims.insert(0, f"Success of {SUCCESS} on chairs: {reached}, {spread(success)}.")
    collided = 1 - np.mean(ours.column("success")) - np.mean(ours.column("no path"))
    lines = "\n".join(f"- {claim}" for claim in claims)
    return f"""The paper's claims, and what remains of them here. Differences are `{model}` minus the other method:

{lines}

For {collided:.1%} of all pairs, the path planned on `{model}` meets the true object. A robot should keep a clearance,
and look again on its way."""


def _against_direct(record: PaperRecord, ours: Trial) -> str:
    """Return the verdict on the direct decoder, beside HOF-1 of as many steps if that was measured; or why not."""
    claim = "Success above that of a direct decoder"
    trained = {trial.method: trial for trial in record.trials}
    direct = next((name for name in trained if name.startswith(f"{DIRECT}, ")), None)
    if direct:
        alike = direct.replace(DIRECT, HOF)
        of = f" ({alike} minus {direct})" if alike in trained else ""
        return f"{claim}{of}: {_difference(trained.get(alike, ours), trained[direct], 'success')}."
    return (
        f"{claim}: not measured, because no trained one is kept. `hof-model train --method direct` trains one, and "
        f"`hof-model paper paths --run FOLDER` measures it."
    )


def _difference(ours: Trial, other: Trial, figure: str) -> str:
    """Return a verdict, and the paired difference over the objects for which both figures exist."""
    gaps = ours.column(figure) - other.column(figure)
    if np.isnan(gaps).all():
        return "undecided, since no object has both figures"
    gap = interval(gaps[~np.isnan(gaps)])
    verdict = "holds" if gap[1] > 0 else "does not hold" if gap[2] < 0 else "undecided"
    return f"{verdict}, {spread(gap, '+')}"
