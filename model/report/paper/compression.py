"""Write the section of PAPER.md on theta against compressed meshes."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from model.evaluation.paper.compression import BYTES, DRACO, DTYPES, FIGURES, FLOOR, GLTF, THETA, trial_name
from model.evaluation.paper.record import PaperRecord, Values
from model.metrics import interval
from model.report.tables import spread, table
from service.formats.precision import Dtype

METHODS: Final = (THETA, DRACO, GLTF)


def section(record: PaperRecord) -> str:
    """Return the section: setting, table, verdict."""
    setting, origin = record.setting, record.origin
    names = [trial_name(method, dtype) for dtype in DTYPES for method in METHODS] + [FLOOR]
    bits = " or ".join(map(str, setting["bits"]))
    head = ["method, at the size of theta as", *FIGURES, "bytes, mean", "objects"]
    return f"""## Mesh to function, and compressed meshes

How much of a mesh fits into {origin["model"]}'s theta, and into a compressed mesh of as many bytes. Written by
`hof-model paper fit`: the first {setting["objects"]} objects of the {setting["split"]} split, theta fitted by
{setting["steps"]:,} steps of `hof-model fit`, {setting["points"]:,} points a cloud, seed {origin["seed"]};
{origin["machine"]}, {origin["date"]}, commit {origin["commit"]}.

- *{THETA}*: a safetensors file, its header included. No image is involved: this bounds what an encoder can reach.
- *{DRACO}*: the mesh, decimated until its file is no larger, with positions of {bits} bits: the better one
  counts.
- *{GLTF}*: a binary glTF file with positions of 16 bits and no other compression, decimated likewise.
- *{FLOOR}*: another sample of the true surface. Intervals are 95% bootstrap intervals over objects.

{table(head, [_cells(record, name) for name in names])}

{_verdict(record)}"""


def _cells(record: PaperRecord, name: str) -> list[str]:
    trial = record.trial(name)
    sizes = _present(trial.column(BYTES))
    figures = [_present(trial.column(figure)) for figure in FIGURES]
    shown = [spread(interval(values)) if values.size else "-" for values in figures]
    return [name, *shown, f"{sizes.mean():,.0f}" if sizes.size else "-", str(figures[0].size)]


def _verdict(record: PaperRecord) -> str:
    """Return what fewer bytes cost theta, and theta's paired difference to each compressed mesh."""
    figure = FIGURES[0]
    exact = record.trial(trial_name(THETA, "float32")).column(figure)
    costs = [
        f"{dtype} {spread(interval(record.trial(trial_name(THETA, dtype)).column(figure) - exact), '+')}"
        for dtype in DTYPES[1:]
    ]
    lines = [_against(record, method, DTYPES, figure) for method in (DRACO, GLTF)]
    return f"""{figure.upper()} of theta in fewer bytes minus that of float32: {"; ".join(costs)}.

{figure.upper()} of theta minus that of a mesh of as many bytes, paired over objects. The paper compares with other
decoders alone:

{chr(10).join(lines)}"""


def _against(record: PaperRecord, method: str, dtypes: Sequence[Dtype], figure: str) -> str:
    parts = []
    for dtype in dtypes:
        gaps = _present(
            record.trial(trial_name(THETA, dtype)).column(figure)
            - record.trial(trial_name(method, dtype)).column(figure)
        )
        parts.append(f"{spread(interval(gaps), '+') if gaps.size else 'no object is small enough'} as {dtype}")
    return f"- {method}: {'; '.join(parts)}."


def _present(values: Values) -> Values:
    present: Values = values[~np.isnan(values)]
    return present
