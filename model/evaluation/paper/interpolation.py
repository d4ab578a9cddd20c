"""Experiment 8: words of two objects against the mean of their thetas, from the records of `hof-model mixtures`."""

from pathlib import Path
from typing import Final

import numpy as np

from model.evaluation.mixtures import AVERAGE, Mixtures
from model.evaluation.paper.record import PaperRecord, Trial, rounded

EXPERIMENT: Final = "interpolation"
WORDS: Final = "words"
MEAN: Final = "mean of thetas"
OBJECTS: Final = "the two objects"
NEAREST: Final = "nearest"
TO_PARENT: Final = "to the nearer parent"


def interpolation_record(folder: Path) -> PaperRecord:
    """Return the record of all models whose mixtures were measured.

    Raises
    ------
    FileNotFoundError : `hof-model mixtures` has measured none.
    """
    measured = [Mixtures.read(path) for path in sorted(folder.glob("*.json"))]
    if not measured:
        raise FileNotFoundError(f"{folder} holds no mixtures: run `hof-model mixtures` first")
    first = measured[0]
    trials = [trial for mixtures in measured for trial in _trials(mixtures)]
    models = {each.model: {"k": each.k, "pairs": len(each.pairs), **each.origin} for each in measured}
    ids = [f"{a} + {b}" for a, b, _ in first.pairs]
    classes = ["within a class" if same else "across classes" for *_, same in first.pairs]
    return PaperRecord(EXPERIMENT, {"split": first.split, "models": models}, first.origin, ids, classes, trials)


def trial_name(model: str, kind: str) -> str:
    """Return the name of a model's kind of mixture in the record."""
    return f"{model}, {kind}"


def _trials(mixtures: Mixtures) -> list[Trial]:
    """Return words (the mean over the even ones), the mean of thetas, and the objects themselves."""
    average = mixtures.figures[AVERAGE]
    to_parent = np.minimum(mixtures.words("to_a"), mixtures.words("to_b"))
    kinds = {
        WORDS: (mixtures.words("nearest"), to_parent),
        MEAN: (average["nearest"], np.minimum(average["to_a"], average["to_b"])),
        OBJECTS: (mixtures.parents("nearest"), np.full(len(mixtures.pairs), np.nan)),
    }
    return [
        Trial(trial_name(mixtures.model, kind), {NEAREST: rounded(nearest), TO_PARENT: rounded(parent)})
        for kind, (nearest, parent) in kinds.items()
    ]
