"""Assemble RESULTS.md from records."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from model.evaluation.compared import COMPARED
from model.evaluation.comparison import BLOB, ORACLE, RETRIEVAL
from model.evaluation.conditions import FREE_VIEWS
from model.evaluation.evaluate import POINTS, VIEWS, Evaluation
from model.evaluation.paths import RESULTS
from model.evaluation.records import Decoder, Record
from model.report import tables
from model.report.sheets import SHOWN, SHOWN_PER_CLASS

# Mitchell et al. 2020, tables 1 and 2.
PAPER: Final = """| method | CD(P, T) | CD(T, P) | parameters | layers |
|---|---|---|---|---|
| 3D-R2N2 | 2.588 | 3.342 | 2,000,000+ | 12 |
| PSG | 1.982 | 2.146 | - | - |
| EPCG | 1.846 | 1.701 | 60,000,000+ | 8 |
| FoldingNet | 1.563 | 1.534 | 1,056,775 | 6 |
| DeepSDF | 1.521 | 0.962 | 1,578,241 | 8 |
| HOF-1 | 1.517 | 1.021 | 7,171 | 2 |
| HOF-3 | 1.480 | 1.014 | 34,052 | 4 |

| method | F@1%, class-uniform | F@1%, class-weighted |
|---|---|---|
| oracle nearest neighbour | 0.290 | 0.321 |
| AtlasNet | 0.252 | 0.287 |
| OGN | 0.217 | 0.230 |
| Matryoshka | 0.264 | 0.297 |
| retrieval | 0.237 | 0.260 |
| HOF | 0.291 | 0.310 |"""


@dataclass(frozen=True)
class Shipped:
    """The model that is reported: its name, digest, size on disk in bytes, milliseconds per image on one core."""

    name: str
    digest: str
    bytes_: int
    ms: float


def markdown(
    ours: Record,
    others: Sequence[Record],
    shipped: Shipped,
    classes: Sequence[str],
    asked: str,
    sections: Sequence[str],
) -> str:
    """The whole page; `classes` of the objects in order, `asked` the table of asked figures, `sections` of other
    measurements."""
    evaluations = all_evaluations(ours, others)
    decoders = {record.method: record.decoder for record in (ours, *others) if record.decoder}
    return "\n\n".join(
        [
            _head(ours, shipped),
            f"## Asked and measured\n\n{asked}",
            _comparison(evaluations, decoders, ours.method),
            _classes(evaluations, classes, ours),
            f"## Points\n\n{tables.by_count(evaluations, ours.method)}",
            _conditions(evaluations, [ours.method, RETRIEVAL]),
            *sections,
            _trained(others),
            f"## The paper's own figures\n\nAnother data set (ShapeNet) and scale: not to be compared.\n\n{PAPER}",
            _pictures(ours, shipped),
        ]
    )


def all_evaluations(ours: Record, others: Sequence[Record]) -> list[Evaluation]:
    """All of them, the shipped model's first."""
    first = sorted(ours.evaluations, key=lambda found: found.method != ours.method)
    return [*first, *(found for record in others for found in record.evaluations)]


def _head(ours: Record, shipped: Shipped) -> str:
    made = ours.made
    training = made["training"]
    return f"""# Results

Written by `make results`: the shipped weights, evaluated along the path of a user's bytes (PNG, `service.encoding`,
the ONNX file, the sampler), beside answers that need no training and the raw metrics in `{RESULTS}`.

- Machine: {made["machine"]}. Date: {made["date"]}. Seed: {made["seed"]}. Commit: {made["commit"]}.
- Data: Sweet Home 3D furniture, {ours.split} split, {len(ours.ids)} objects that no training object repeats, views
  {", ".join(map(str, VIEWS))} of 24; {POINTS:,} predicted against 10,000 true points where nothing else is said.
- Model: `{shipped.name}`, sha256 {shipped.digest[:16]}, {shipped.bytes_ / 1e6:.1f} MB, {shipped.ms:.1f} ms an image on
  one core (onnxruntime, one thread, median of 50). Training: {training.get("steps", 0):,} steps in
  {training.get("minutes", 0)} minutes.

Figures are means over objects (class-weighted), with the 95% bootstrap interval over objects. `cd_forward` and
`cd_backward` are cd_epcg, the mean unsquared nearest distance predicted -> true and true -> predicted, x100 of the
longest side; `cd_sq` is the sum of both squared, x100; `f@t` is the F-score at t of the longest side."""


def _comparison(evaluations: Sequence[Evaluation], decoders: dict[str, Decoder], method: str) -> str:
    return f"""## Comparison

{tables.comparison(evaluations, decoders)}

Milliseconds are on one core: the shipped model in the service's sampler, other trained methods in torch.
`benchmarks/RESULTS.md` times the decoders in their best form each. Mean shape: points of all training objects
together. Image retrieval: the training object whose image, any of its 24 views, is nearest by cosine of pretrained
EfficientNet-Lite0 features. Oracle: the training object nearest to the truth by summed cd_epcg. Blob: the ellipsoid
with the true points' mean and covariance. Same surface: what a fresh sample of the true surface would get.

Differences, object by object; bold where the paired interval excludes 0. Distances are better below 0, F-scores above.

{tables.differences(evaluations, method)}"""


def _classes(evaluations: Sequence[Evaluation], classes: Sequence[str], ours: Record) -> str:
    found, blob = (tables.find(evaluations, method).column("f@2%") for method in (ours.method, BLOB))
    beaten = [id_ for id_, here, there in zip(ours.ids, found, blob, strict=True) if here <= there]
    return f"""## Classes

By rules on the catalogue's names (`model/evaluation/classes.py`). Class-uniform means count every class alike,
class-weighted ones every object.

{tables.per_class(evaluations, [ours.method, RETRIEVAL, ORACLE, BLOB], classes)}

Objects whose prediction is no better than their blob in f@2%, {len(beaten)} of {len(ours.ids)}:
{", ".join(beaten) or "none"}."""


def _conditions(evaluations: Sequence[Evaluation], methods: Sequence[str]) -> str:
    return f"""## Harder images

The same objects: by other cameras (elevation 0 to 45 degrees, any azimuth, other focal lengths; views
{", ".join(map(str, FREE_VIEWS))} of 12), on flat colours, on photographs held out from training, and in grey.

{tables.by_condition(evaluations, methods)}"""


def _trained(others: Sequence[Record]) -> str:
    rows = []
    for record in others:
        training = record.made.get("training", {})
        spent = [f"{training['steps']:,}", str(training["minutes"])] if training else ["-"] * 2
        file = record.made.get("digest", "-")[:16]
        rows.append([record.method, *spent, str(record.made["seed"]), str(record.made["commit"]), file])
    known = (
        tables.table(["method", "steps", "minutes", "seed", "commit", "sha256 of the exported file"], rows)
        if rows
        else "None yet."
    )
    return f"""## Other methods

The other shipped models; methods that are only compared, which `hof-model retrain` trains anew and measures: one data
set, split, image encoder (the paper's DenseNet, from scratch) and number of steps; and the ceiling, theta fitted to
each object's points (`hof-model evaluate --ceiling`). The config of each is in its file.

{known}{_alike(others)}"""


def _alike(others: Sequence[Record]) -> str:
    """The compared methods against HOF-1 with k = 2, where all of them were trained."""
    same = [record for record in others if record.method.partition(",")[0] in COMPARED]
    base = next((record.method for record in same if record.method.startswith("hof1-k2,")), None)
    if base is None:
        return ""
    return f"""

Among those that differ in the decoder alone, object by object as above. A distance above 0 or an F-score below 0 in
bold is where HOF does not win.

{tables.differences([found for record in same for found in record.evaluations], base)}"""


def _pictures(ours: Record, shipped: Shipped) -> str:
    return f"""## Pictures

The first {min(SHOWN, len(ours.ids))} objects in manifest order: the image that went in (view {VIEWS[0]}), the true
points, the predicted points, both seen from 30 degrees to the side and 22 degrees above.

![image, truth, prediction]({RESULTS}/{shipped.name}.png)

The first {SHOWN_PER_CLASS} objects of each class of everyday furniture, in manifest order.

![everyday furniture]({RESULTS}/{shipped.name}-everyday.png)
"""
