"""A small record of measured surfaces, for tests of its page."""

from model.evaluation.surfaces import CLOUD, SERVED, Trial, Trials


def _trial(way: str, f: float, ms: float) -> Trial:
    return Trial(way, {"f@1%": [f / 2] * 2, "f@2%": [f] * 2}, [True, False], [10, 20], [ms, ms])


def trials(f: float, ms: float) -> Trials:
    """Return trials of two objects; the points have an F@2% of 0.4, the served surface f and ms."""
    source = {"model": "m", "split": "test", "objects": 2, "machine": "x", "date": "y", "commit": "z"}
    return Trials(source, [_trial(CLOUD, 0.4, 1), _trial(SERVED, f, ms)])
