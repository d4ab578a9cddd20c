"""Assemble RESULTS.md from records."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from model.evaluation.comparison import ELLIPSOID, ORACLE, RETRIEVAL
from model.evaluation.conditions import FREE_VIEWS
from model.evaluation.evaluate import PREDICTED_POINTS, VIEWS, Evaluation
from model.evaluation.locations import RESULTS
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
| oracle nearest neighbor | 0.290 | 0.321 |
| AtlasNet | 0.252 | 0.287 |
| OGN | 0.217 | 0.230 |
| Matryoshka | 0.264 | 0.297 |
| retrieval | 0.237 | 0.260 |
| HOF | 0.291 | 0.310 |"""


@dataclass(frozen=True)
class Shipped:
    """The model of the page: name, digest, bytes on disk, milliseconds per image on one core."""

    name: str
    digest: str
    bytes_: int
    ms: float


def markdown(
    ours: Record,
    others: Sequence[Record],
    shipped: Shipped,
    classes: Sequence[str],
    targets: str,
    sections: Sequence[str],
) -> str:
    """Return the whole page.

    Parameters
    ----------
    classes : of the objects, in order.
    targets : the table of targets.
    sections : of other measurements.
    """
    evaluations = all_evaluations(ours, others)
    decoders = {record.method: record.decoder for record in (ours, *others) if record.decoder}
    return "\n\n".join(
        [
            _head(ours, shipped),
            f"## Targets\n\n{targets}",
            _comparison(evaluations, decoders, ours.method),
            _classes(evaluations, classes, ours),
            f"## Points\n\n{tables.by_count(evaluations, ours.method)}",
            _conditions(evaluations, [ours.method, RETRIEVAL]),
            *sections,
            _trained(others),
            f"## The paper's own figures\n\nOn another data set (ShapeNet) and scale: not comparable.\n\n{PAPER}",
            _pictures(ours, shipped),
        ]
    )


def all_evaluations(ours: Record, others: Sequence[Record]) -> list[Evaluation]:
    """Return all evaluations, those of the shipped model first."""
    first = sorted(ours.evaluations, key=lambda evaluation: evaluation.method != ours.method)
    return [*first, *(evaluation for record in others for evaluation in record.evaluations)]


def _head(ours: Record, shipped: Shipped) -> str:
    origin = ours.origin
    training = origin["training"]
    return f"""# Results

Written by `make results`: the shipped weights, evaluated along the path of a user's bytes (PNG, `service.encoding`, the
ONNX file, the sampler), beside references that need no training and the raw metrics in `{RESULTS}`.

- Machine: {origin["machine"]}. Date: {origin["date"]}. Seed: {origin["seed"]}. Commit: {origin["commit"]}.
- Data: Sweet Home 3D furniture, {ours.split} split, {len(ours.ids)} objects that repeat no training object, views
  {", ".join(map(str, VIEWS))} of 24; {PREDICTED_POINTS:,} predicted against 10,000 true points unless stated otherwise.
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
`benchmarks/RESULTS.md` times each decoder in its best form. Mean shape: points of all training objects together. Image
retrieval: the training object with the most similar view, by cosine of pretrained EfficientNet-Lite0 features. Oracle
nearest neighbor: the training object nearest to the truth by summed cd_epcg; among all training shapes: also of their
stretched and warped copies and of the pieces. Moment-matched ellipsoid: the ellipsoid
with the mean and covariance of the true points. Sampling floor: another sample of the true surface.

Differences are object by object, bold where the paired interval excludes 0. Distances are better below 0, F-scores
above 0.

{tables.differences(evaluations, method)}"""


def _classes(evaluations: Sequence[Evaluation], classes: Sequence[str], ours: Record) -> str:
    scores, bounds = (tables.find(evaluations, method).column("f@2%") for method in (ours.method, ELLIPSOID))
    beaten = [id_ for id_, score, bound in zip(ours.ids, scores, bounds, strict=True) if score <= bound]
    return f"""## Classes

Classes follow from rules on the catalog's names (`model/evaluation/classes.py`). Class-uniform means count every class
equally, class-weighted means every object.

{tables.per_class(evaluations, [ours.method, RETRIEVAL, ORACLE, ELLIPSOID], classes)}

Objects whose prediction is no better in f@2% than their moment-matched ellipsoid, {len(beaten)} of {len(ours.ids)}:
{", ".join(beaten) or "none"}."""


def _conditions(evaluations: Sequence[Evaluation], methods: Sequence[str]) -> str:
    return f"""## Harder images

The same objects from other cameras (elevation 0 to 45 degrees, any azimuth, other focal lengths; views
{", ".join(map(str, FREE_VIEWS))} of 12), on flat colors, on photographs held out from training, and in gray.
Photographs are cut out by `hof-matte`; "Mattes" has the other ways.

{tables.by_condition(evaluations, methods)}"""


def _trained(others: Sequence[Record]) -> str:
    rows = []
    for record in others:
        training = record.origin.get("training", {})
        spent = [f"{training['steps']:,}", str(training["minutes"])] if training else ["-"] * 2
        file = record.origin.get("digest", "-")[:16]
        rows.append([record.method, *spent, str(record.origin["seed"]), str(record.origin["commit"]), file])
    methods = (
        tables.table(["method", "steps", "minutes", "seed", "commit", "sha256 of the exported file"], rows)
        if rows
        else "None yet."
    )
    return f"""## Other methods

The other shipped models, and the ceiling: theta fitted to each object's points (`hof-model evaluate --ceiling`). The
config of each is in its file. [PAPER.md](PAPER.md) compares HOF with other decoders, all trained alike.

{methods}"""


def _pictures(ours: Record, shipped: Shipped) -> str:
    return f"""## Pictures

The first {min(SHOWN, len(ours.ids))} objects in manifest order: the input image (view {VIEWS[0]}), the true points and
the predicted points, both seen from 30 degrees to the side and 22 degrees above.

![image, truth, prediction]({RESULTS}/{shipped.name}.png)

The first {SHOWN_PER_CLASS} objects of each class of everyday furniture, in manifest order.

![everyday furniture]({RESULTS}/{shipped.name}-everyday.png)
"""
