"""Table of EPCG's protocol: a row of the paper's Table 1, and its classes."""

import numpy as np

from model.evaluation.epcg import FIGURES
from model.evaluation.paper.record import PaperRecord, Values
from model.report.tables import table


def section(record: PaperRecord) -> str:
    """Return the row of Table 1 as a table, standard errors in parentheses, then the table of classes."""
    setting, trial = record.setting, record.trials[0]
    forward, backward = (trial.column(figure) for figure in FIGURES)
    labels = np.array(record.classes)
    classes = sorted(set(record.classes))
    by_class = [(name, forward[labels == name], backward[labels == name]) for name in classes]
    row = [
        trial.method,
        *(_cell(values) for values in (forward, backward, (forward + backward) / 2)),
        f"{setting['parameters']:,}",
        str(setting["layers"]),
    ]
    rows = [
        [name, str(len(to_true)), f"{to_true.mean():.3f}", f"{back.mean():.3f}"] for name, to_true, back in by_class
    ]
    means = [np.mean([ahead.mean() for _, ahead, _ in by_class]), np.mean([back.mean() for *_, back in by_class])]
    rows.append(["mean of the classes", str(len(labels)), *(f"{mean:.3f}" for mean in means)])
    return f"""{table(["Method", "CD(P,T)", "CD(T,P)", "Average CD", "Parameters", "Layers"], [row])}

{setting["objects"]} objects of the {setting["split"]} split, {setting["views"]} views each, {setting["points"]:,}
predicted against {setting["true_points"]:,} true points; mean over objects and its standard error.

{table(["Category", "objects", "CD(P,T)", "CD(T,P)"], rows)}"""


def _cell(values: Values) -> str:
    return f"{values.mean():.3f} ({values.std() / len(values) ** 0.5:.4f})"
