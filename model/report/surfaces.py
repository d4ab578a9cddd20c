"""Write the section of RESULTS.md on surfaces."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from model.evaluation.evaluate import POINTS, VIEWS
from model.evaluation.surfaces import METRICS, SERVED, Trial, Trials
from model.report.tables import table

SHARE: Final = 0.95  # of the points' own F@2%, at least
MOST_MS: Final = 500.0


def section(found: Trials) -> str:
    """The section of RESULTS.md: what was asked, the table, and why the service makes surfaces as it does."""
    cloud, made = found.trials[0], found.made
    served = next(trial for trial in found.trials if trial.way == SERVED)
    share, longest = _share(served, cloud), max(served.ms)
    rows = [[trial.way, *_row(trial, cloud)] for trial in found.trials]
    head = ["way", *METRICS, "share of the points' f@2%", "closed", "triangles", "ms, median", "ms, most"]
    return f"""## Surfaces

Written by `hof-model surfaces`: `{made["model"]}`, {made["split"]} split, view {VIEWS[0]} of {made["objects"]} objects,
{POINTS:,} points drawn uniformly from each surface against 10,000 true ones. Milliseconds are CPU time of one thread,
from theta to triangles, on {made["machine"]}, {made["date"]}, commit {made["commit"]}.

{table(head, rows)}

- F@2% at least {SHARE} of the points' own: {share:.3f}, {_met(share >= SHARE)}.
- Under {MOST_MS:.0f} ms at the default resolution: {longest:.0f} ms at most, {_met(longest < MOST_MS)}.

The service pushes shells through f and cuts what is torn. {_rank(found.trials[1:], served)} Points are dense where the
object is certain and thin where it is not. A surface counts by area: what encloses points at one level, or at one
distance, gives the thin places as much weight as the dense ones, and lies beside them, not in them. Poisson and ball
pivoting first have to find out which points are neighbours and which way they face; that is slow, and where the points
are a cloud and no sheet Poisson guesses wrong. f knows: its layers lie where its points are, many of them where they
are dense, and a triangle that it stretches is one where points are thin. They are smooth, which a level of a density
is not, and need no library. What they are not is closed: who needs a solid to print takes the points to a tool that
makes one."""


def _rank(trials: Sequence[Trial], served: Trial) -> str:
    """How the served way stands among all by F@2%, and among the quick ones."""
    better = [trial for trial in trials if trial.mean("f@2%") > served.mean("f@2%")]
    quick = [trial.way for trial in better if np.median(trial.ms) < MOST_MS]
    slow = [trial.way for trial in better if trial.way not in quick]
    told = f"Nearer to the truth, under {MOST_MS:.0f} ms: {', '.join(quick) or 'no other way'}."
    return f"{told} Nearer, but slower: {', '.join(slow)}." if slow else told


def _row(trial: Trial, cloud: Trial) -> list[str]:
    figures = [f"{trial.mean(metric):.3f}" for metric in METRICS]
    share = f"{_share(trial, cloud):.3f}"
    if trial is cloud:
        return [*figures, share, "-", "-", f"{np.median(trial.ms):.0f}", f"{max(trial.ms):.0f}"]
    closed, triangles = f"{np.mean(trial.closed):.0%}", f"{np.mean(trial.triangles):,.0f}"
    return [*figures, share, closed, triangles, f"{np.median(trial.ms):.0f}", f"{max(trial.ms):.0f}"]


def _share(trial: Trial, cloud: Trial) -> float:
    """Of the points' F@2%; 0 where they have none."""
    own = cloud.mean("f@2%")
    return trial.mean("f@2%") / own if own else 0.0


def _met(condition: bool) -> str:
    return "met" if condition else "**not met**"
