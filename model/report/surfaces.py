"""Write the section of RESULTS.md on surfaces."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from model.evaluation.evaluate import PREDICTED_POINTS, VIEWS
from model.evaluation.surfaces import METRICS, SERVED, Trial, Trials
from model.report.tables import table

SHARE: Final = 0.95  # of the points' own F@2%, at least
MOST_MS: Final = 500.0


def section(trials: Trials) -> str:
    """Return the section: the table, the targets, and why the service makes surfaces as it does."""
    cloud, origin = trials.trials[0], trials.origin
    served = next(trial for trial in trials.trials if trial.way == SERVED)
    share, longest = _share(served, cloud), max(served.ms)
    rows = [[trial.way, *_row(trial, cloud)] for trial in trials.trials]
    head = ["way", *METRICS, "share of the points' f@2%", "closed", "triangles", "ms, median", "ms, most"]
    return f"""## Surfaces

Written by `hof-model surfaces`: `{origin["model"]}`, {origin["split"]} split, view {VIEWS[0]} of {origin["objects"]}
objects, {PREDICTED_POINTS:,} points drawn uniformly from each surface against 10,000 true ones. Milliseconds are CPU
time of one thread, from theta to triangles, on {origin["machine"]}, {origin["date"]}, commit {origin["commit"]}.

{table(head, rows)}

- F@2% at least {SHARE} of the points' own: {share:.3f}, {_met(share >= SHARE)}.
- Under {MOST_MS:.0f} ms at the default resolution: {longest:.0f} ms at most, {_met(longest < MOST_MS)}.

The service maps shells through f and cuts the triangles that f tears apart. {_rank(trials.trials[1:], served)}

- Points are dense where the model is certain of the object, and sparse elsewhere. A surface counts by area: one that
  encloses the points at a density or at a distance gives sparse regions as much weight as dense ones, and lies beside
  the points instead of among them.
- Poisson and ball pivoting first estimate which points are neighbors and which way they face. That is slow, and Poisson
  errs where the points form a cloud instead of a sheet.
- The layers of f lie where its points are, many of them where points are dense; f stretches a triangle where points are
  sparse. The layers are smooth, unlike a level of a density, and need no library.
- They are not closed. To print a solid, use a tool that makes one from the points."""


def _rank(trials: Sequence[Trial], served: Trial) -> str:
    """Return sentences on the ways that are better than the served one by F@2%, fast ones and slow ones apart."""
    better = [trial for trial in trials if trial.mean("f@2%") > served.mean("f@2%")]
    quick = [trial.way for trial in better if np.median(trial.ms) < MOST_MS]
    slow = [trial.way for trial in better if trial.way not in quick]
    sentence = f"Better in F@2% and under {MOST_MS:.0f} ms: {', '.join(quick) or 'no other way'}."
    return f"{sentence} Better, but slower: {', '.join(slow)}." if slow else sentence


def _row(trial: Trial, cloud: Trial) -> list[str]:
    figures = [f"{trial.mean(metric):.3f}" for metric in METRICS]
    share = f"{_share(trial, cloud):.3f}"
    if trial is cloud:
        return [*figures, share, "-", "-", f"{np.median(trial.ms):.0f}", f"{max(trial.ms):.0f}"]
    closed, triangles = f"{np.mean(trial.closed):.0%}", f"{np.mean(trial.triangles):,.0f}"
    return [*figures, share, closed, triangles, f"{np.median(trial.ms):.0f}", f"{max(trial.ms):.0f}"]


def _share(trial: Trial, cloud: Trial) -> float:
    """Return a trial's share of the points' own F@2%; 0 if that is 0."""
    reference = cloud.mean("f@2%")
    return trial.mean("f@2%") / reference if reference else 0.0


def _met(condition: bool) -> str:
    return "met" if condition else "**not met**"
