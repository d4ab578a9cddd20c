"""Write the section of PAPER.md on interpolation: words against means of thetas."""

import numpy as np

from model.evaluation.paper.interpolation import MEAN, NEAREST, OBJECTS, TO_PARENT, WORDS, trial_name
from model.evaluation.paper.record import PaperRecord, Values
from model.metrics import interval
from model.report.tables import spread, table

COLUMNS = (NEAREST, TO_PARENT)


def section(record: PaperRecord) -> str:
    """Return the section: a table of all models' mixtures, verdicts of each model."""
    rows = [[trial.method, *(_cell(trial.column(name)) for name in COLUMNS)] for trial in record.trials]
    models = record.setting["models"]
    measured = "; ".join(f"{name}, k = {each['k']}, {each['pairs']} pairs" for name, each in models.items())
    lines = "\n".join(f"- `{model}`: {_verdict(record, model)}" for model in models)
    return f"""## Interpolation

Two objects are mixed by words of their functions, or by the mean of their thetas. Written by
`hof-model paper interpolation` from the records of `hof-model mixtures`: {measured}, {record.setting["split"]} split,
commit {record.origin["commit"]}. [RESULTS.md](RESULTS.md) shows pictures and more words. Distances are cd_epcg, both
directions summed, x100: to the nearest training object, small for a coherent shape, and to the nearer of both objects.

{table(["mixture", "to the nearest training object", "to the nearer parent"], rows)}

The paper's claim: words give coherent objects, and means of thetas do not. The mean minus words, paired over pairs:

{lines}"""


def _cell(values: Values) -> str:
    present = values[~np.isnan(values)]
    return spread(interval(present)) if present.size else "-"


def _verdict(record: PaperRecord, model: str) -> str:
    words, mean, objects = (record.trial(trial_name(model, kind)).column(NEAREST) for kind in (WORDS, MEAN, OBJECTS))
    gap = interval(mean - words)
    answer = "holds" if gap[1] > 0 else "does not hold, means lie nearer to real shapes" if gap[2] < 0 else "undecided"
    own = interval(words - objects)
    return f"{answer}, {spread(gap, '+')}. Words minus the objects themselves: {spread(own, '+')}."
