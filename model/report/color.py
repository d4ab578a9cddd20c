"""Write the section of RESULTS.md on color."""

from model.evaluation.color import NAMES
from model.evaluation.evaluate import PREDICTED_POINTS
from model.evaluation.records import Record
from model.metrics import interval
from model.report.tables import find, spread, table


def section(record: Record) -> str:
    """Return the section of RESULTS.md."""
    return f"""## Color

Mean absolute difference per channel (sRGB, 0 to 255): forward from each of {PREDICTED_POINTS:,} predicted points to its
nearest true one, backward from each true one to its nearest predicted one. The constant colors and the true colors use
the model's own points, so that only color is compared; image retrieval has the points and colors of its match. The last
columns are the model's error minus the method's, object by object: below 0 the model is better.

{_table(record)}"""


def _table(record: Record) -> str:
    ours = find(record.evaluations, record.method)
    rows = []
    for other in record.evaluations:
        gaps = [interval(ours.column(name) - other.column(name)) for name in NAMES]
        differences = ["-" if other is ours else spread(gap, "+") for gap in gaps]
        rows.append([other.method, *(spread(interval(other.column(name))) for name in NAMES), *differences])
    return table(["method", "forward", "backward", "forward: model minus method", "backward: model minus method"], rows)
