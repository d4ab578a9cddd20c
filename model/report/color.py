"""Write the section of RESULTS.md on color."""

from model.evaluation.color import NAMES
from model.evaluation.evaluate import POINTS
from model.evaluation.records import Record
from model.metrics import interval
from model.report.tables import find, spread, table


def section(record: Record) -> str:
    """The section of RESULTS.md."""
    return f"""## Colour

Mean absolute difference per channel (sRGB, 0 to 255): forward from each of {POINTS:,} predicted points to its nearest
true one, backward from each true one to its nearest predicted one. A constant colour and the true colours stand on the
model's own points, so that colour alone is compared; image retrieval has points and colours of the object that it
found. The last columns are the model's error less the method's, object by object: below 0 the model is better.

{_table(record)}"""


def _table(record: Record) -> str:
    ours = find(record.evaluations, record.method)
    rows = []
    for found in record.evaluations:
        gaps = [interval(ours.column(name) - found.column(name)) for name in NAMES]
        less = ["-" if found is ours else spread(gap, "+") for gap in gaps]
        rows.append([found.method, *(spread(interval(found.column(name))) for name in NAMES), *less])
    return table(["method", "forward", "backward", "forward: model's less", "backward: model's less"], rows)
