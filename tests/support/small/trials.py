"""Small records of measured surfaces and estimates, for tests of their pages."""

from model.evaluation.estimates.trials import EstimateTrials, Sightings
from model.evaluation.surfaces import CLOUD, SERVED, Trial, Trials


def _trial(way: str, f: float, ms: float) -> Trial:
    return Trial(way, {"f@1%": [f / 2] * 2, "f@2%": [f] * 2}, [True, False], [10, 20], [ms, ms])


def trials(f: float, ms: float) -> Trials:
    """Return trials of two objects; the points have an F@2% of 0.4, the served surface f and ms."""
    source = {"model": "m", "split": "test", "objects": 2, "machine": "x", "date": "y", "commit": "z"}
    return Trials(source, [_trial(CLOUD, 0.4, 1), _trial(SERVED, f, ms)])


def estimate_trials() -> EstimateTrials:
    """Return estimates of two objects in two views each."""
    confidence, scores = [[0.2, 0.4], [0.6, 0.8]], [[0.25, 0.35], [0.55, 0.85]]
    errors = {"azimuth": [[1.0, 2.0], [5.0, 170.0]], "elevation": [[1.0, 2.0], [3.0, 4.0]]}
    sightings = Sightings("test", True, ["a", "b"], confidence, scores, errors, [0.1, 0.1])
    origin = {"model": "m", "digest": "0" * 64, "training": {}, "machine": "x", "date": "y", "commit": "z"}
    return EstimateTrials(origin, [sightings], {"noise": [0.1, 0.2]})
