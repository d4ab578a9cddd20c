"""Write the section of PAPER.md on latent vectors."""

import numpy as np

from model.evaluation.paper.latent import FIGURE, SPECS, trial_name
from model.evaluation.paper.record import PaperRecord
from model.report.tables import table


def section(record: PaperRecord) -> str:
    """Return the section: setting, table, verdict."""
    setting, origin = record.setting, record.origin
    rows = [
        [trial.method, f"{trial.column(FIGURE).max():.1e}", f"{np.median(trial.column(FIGURE)):.1e}"]
        for trial in record.trials
    ]
    is_rounding = all(
        record.trial(trial_name(spec, dtype)).column(FIGURE).max() < 100 * float(np.finfo(dtype).eps)
        for spec in SPECS
        for dtype in (np.float32, np.float64)
    )
    verdict = "holds, to rounding" if is_rounding else "does not hold: the differences are larger than rounding"
    return f"""## A latent vector as a bias

A decoder that reads a latent vector beside each point (LVC) is a mapping function whose objects differ in the biases of
the first layer alone. Written by `hof-model paper latent`: {setting["objects"]} random decoders with a latent vector of
{setting["latent"]} numbers each, {setting["points"]:,} points, seed {origin["seed"]}; {origin["machine"]},
{origin["date"]}, commit {origin["commit"]}. Difference: the largest of a coordinate between both forms of an object,
divided by its largest coordinate.

{table(["function, precision", "largest difference", "median difference"], rows)}

The paper's claim that LVC is a special case of a mapping function: {verdict}. `hof-model paper parts`
measures what more of theta than these biases buys."""
