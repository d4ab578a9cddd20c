"""Write the section of RESULTS.md on the estimates, and its reliability diagram."""

from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from model.evaluation.estimates.trials import EstimateTrials, Sightings
from model.evaluation.evaluate import VIEWS
from model.evaluation.locations import ESTIMATES
from model.networks.observations import SYMMETRIC
from model.report.tables import table

Values = npt.NDArray[np.float64]

BINS: Final = 10
CORRELATION: Final = 0.6  # at least
AZIMUTH_DEG: Final = 10.0  # at most, the median


def sections(root: Path) -> str:
    """Return the section for every record in the results' folder; empty without records."""
    records = [EstimateTrials.read(path) for path in sorted((root / ESTIMATES).glob("*.json"))]
    return "\n\n".join(section(record) for record in records)


def section(trials: EstimateTrials) -> str:
    """Return the section on one model."""
    origin = trials.origin
    training = origin["training"]
    head = ["objects", "images", "true F@2%", "confidence", "correlation", "of object means", "calibration error"]
    head += ["azimuth, median", "within 30 degrees", "elevation, median"]
    return f"""## Estimates of {origin["model"]}

Written by `hof-model estimates`, {origin["date"]}, commit {origin["commit"]}, sha256 {origin["digest"][:16]}. The heads
learned from {training.get("images", 0):,} images of {training.get("objects", 0):,} objects and never saw the sources
below. Views {", ".join(map(str, VIEWS))} of each object, cut out, along the path of a user's bytes.

{table(head, [_row(each) for each in trials.sources])}

The correlation is Pearson's between `shape_confidence` and the true F@2%, over images; asked is {CORRELATION} or more:
{_met([_correlation(each) >= CORRELATION for each in trials.sources])}. The calibration error is the mean distance
between confidence and F@2% over {BINS} bins of the confidence, weighted by their images.

The azimuth's error is over objects that are not symmetric; asked is a median of {AZIMUTH_DEG:.0f} degrees or less:
{_met([np.median(errors) <= AZIMUTH_DEG for errors in map(_azimuths, trials.sources) if len(errors)])}. An object is
symmetric if its true points, turned about the vertical by some multiple of 45 degrees, lie on average within
{SYMMETRIC:.0%} of the longest side of where they were.

{_reliability(trials.sources)}

![reliability]({ESTIMATES}/{origin["model"]}.png)

{table(["image", "images", "confidence, mean", "lowest", "highest"], _strange_rows(trials))}"""


def draw_reliability(trials: EstimateTrials, path: Path) -> None:
    """Draw the mean F@2% by bins of the confidence, a line per source, as a PNG."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(5, 5))
    axes.plot([0, 1], [0, 1], color="gray", linewidth=1)
    for each in trials.sources:
        confidence, scores = _flat(each)
        axes.scatter(confidence, scores, s=4, alpha=0.25)
        means = [(each_bin.confidence, each_bin.score) for each_bin in bins_of(confidence, scores)]
        axes.plot(*zip(*means, strict=True), marker="o", label=each.source)
    axes.set(xlabel="shape confidence", ylabel="true F@2%", xlim=(0, 1), ylim=(0, 1), title=trials.origin["model"])
    axes.legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=90)
    pyplot.close(figure)


def _row(each: Sightings) -> list[str]:
    confidence, scores = _flat(each)
    objects = np.corrcoef(np.mean(each.confidence, axis=1), np.mean(each.scores, axis=1))[0, 1]
    azimuth = _azimuths(each)
    shown = [f"{np.median(azimuth):.1f}°", f"{(azimuth <= 30).mean():.0%}"] if len(azimuth) else ["-", "-"]
    return [
        f"{each.source} ({len(each.ids)})",
        str(len(scores)),
        f"{scores.mean():.3f}",
        f"{confidence.mean():.3f}",
        f"{_correlation(each):.3f}",
        f"{objects:.3f}",
        f"{calibration_error(confidence, scores):.3f}",
        *shown,
        f"{np.median(each.errors['elevation']):.1f}°",
    ]


def _reliability(sources: list[Sightings]) -> str:
    """Return the table of the true F@2% by bins of the confidence, a pair of columns per source."""
    binned = [{each_bin.number: each_bin for each_bin in bins_of(*_flat(each))} for each in sources]
    rows = []
    for number in range(BINS):
        cells = [f"{bins[number].score:.3f} ({bins[number].images})" if number in bins else "-" for bins in binned]
        rows.append([f"{number / BINS:.1f} to {(number + 1) / BINS:.1f}", *cells])
    return table(["confidence", *(f"F@2% of {each.source} (images)" for each in sources)], rows)


def _strange_rows(trials: EstimateTrials) -> list[list[str]]:
    return [
        [kind, str(len(values)), f"{np.mean(values):.3f}", f"{min(values):.3f}", f"{max(values):.3f}"]
        for kind, values in trials.strange.items()
    ]


def calibration_error(confidence: Values, scores: Values) -> float:
    """Return the mean distance between confidence and score over bins of the confidence, weighted by their images."""
    bins = bins_of(confidence, scores)
    return sum(each.images * abs(each.confidence - each.score) for each in bins) / len(scores)


class Bin(NamedTuple):
    """Images of similar confidence: number of the bin, number of images, mean confidence and mean score."""

    number: int
    images: int
    confidence: float
    score: float


def bins_of(confidence: Values, scores: Values) -> list[Bin]:
    """Return the bins that have images, in order."""
    places = np.minimum((confidence * BINS).astype(int), BINS - 1)
    bins = []
    for number in np.unique(places).tolist():
        here = places == number
        bins.append(Bin(number, int(here.sum()), float(confidence[here].mean()), float(scores[here].mean())))
    return bins


def _flat(each: Sightings) -> tuple[Values, Values]:
    """Return confidences and scores of all images, (n,) each."""
    return np.array(each.confidence).ravel(), np.array(each.scores).ravel()


def _azimuths(each: Sightings) -> Values:
    """Return the azimuth's errors where it is known and unique; none for a source without fronts."""
    return each.azimuth_errors() if each.has_front else np.empty(0)


def _correlation(each: Sightings) -> float:
    return float(np.corrcoef(*_flat(each))[0, 1])


def _met(conditions: list[Any]) -> str:
    """Return in words how many of the conditions hold."""
    held = sum(map(bool, conditions))
    return "met" if held == len(conditions) else f"**met by {held} of {len(conditions)}**"
