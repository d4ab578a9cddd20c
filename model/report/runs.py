"""Write the section of RESULTS.md on the runs of model/LAB.md, measured on the validation split."""

from pathlib import Path

from model.evaluation.comparison import ORACLE
from model.evaluation.locations import RUNS
from model.evaluation.records import Record
from model.metrics import NAMES, interval
from model.report.tables import find, loss, spread, table


def section(root: Path) -> str:
    """Return the section, empty without records.

    It has a row per record that `hof-model evaluate --run RUN --photographs -o` wrote to RUNS, and one for the oracle.
    """
    records = [Record.read(path) for path in sorted((root / RUNS).glob("*.json"), key=_number)]
    if not records:
        return ""
    rows = [list(row) for row in dict.fromkeys(tuple(row) for record in records for row in _rows(record))]
    objects, split = len(records[0].ids), records[0].split
    head = ["run", "steps", "minutes", *NAMES, "photographs: loss of f@2%"]
    return f"""## Runs

The runs of `model/LAB.md`, which describes the change in each, on the {objects} objects of the
{split} split (`hof-model evaluate --run RUN --photographs -o {RUNS}/RUN.json`). Steps and minutes include the runs that
a run started from.

{table(head, rows)}"""


def _number(path: Path) -> tuple[int, str]:
    """Return a sort key with run-9 before run-10."""
    return len(path.name), path.name


def _rows(record: Record) -> list[list[str]]:
    """Return the run's row, and the oracle's if it was measured with the run."""
    methods = [record.method, *({ORACLE} & {evaluation.method for evaluation in record.evaluations})]
    training = record.origin["training"]
    rows = []
    for method in methods:
        figures = [spread(interval(find(record.evaluations, method).column(name))) for name in NAMES]
        ours = method == record.method
        spent = [f"{training['steps']:,}", str(training["minutes"])] if ours else ["-", "-"]
        lost = f"{loss(record.evaluations, method, 'photograph'):.1f}%" if ours else "-"
        rows.append([method, *spent, *figures, lost])
    return rows
