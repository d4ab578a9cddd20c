"""The section of RESULTS.md on what was tried to reach the figures that are short: runs, on the validation split."""

from pathlib import Path

from model.evaluation.comparison import ORACLE
from model.evaluation.paths import RUNS
from model.evaluation.records import Record
from model.metrics import NAMES, interval
from model.report.tables import find, loss, spread, table


def section(root: Path) -> str:
    """A row for each record that `hof-model evaluate --run RUN --photographs -o` wrote to RUNS, one for the oracle;
    empty without any record."""
    records = [Record.read(path) for path in sorted((root / RUNS).glob("*.json"), key=_number)]
    if not records:
        return ""
    rows = [list(row) for row in dict.fromkeys(tuple(row) for record in records for row in _rows(record))]
    objects, split = len(records[0].ids), records[0].split
    head = ["run", "steps", "minutes", *NAMES, "photographs: loss of f@2%"]
    return f"""## What was tried

The runs of `model/LAB.md`, which tells what each changed and what else was tried, on the {objects} objects of the
{split} split (`hof-model evaluate --run RUN --photographs -o {RUNS}/RUN.json`). Steps and minutes count the runs
that one started from.

{table(head, rows)}"""


def _number(path: Path) -> tuple[int, str]:
    """run-9 before run-10."""
    return len(path.name), path.name


def _rows(record: Record) -> list[list[str]]:
    """The run's, and the oracle's where it was measured with it."""
    methods = [record.method, *({ORACLE} & {found.method for found in record.evaluations})]
    training = record.made["training"]
    rows = []
    for method in methods:
        figures = [spread(interval(find(record.evaluations, method).column(name))) for name in NAMES]
        ours = method == record.method
        spent = [f"{training['steps']:,}", str(training["minutes"])] if ours else ["-", "-"]
        lost = f"{loss(record.evaluations, method, 'photograph'):.1f}%" if ours else "-"
        rows.append([method, *spent, *figures, lost])
    return rows
