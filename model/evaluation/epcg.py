"""The protocol of Lin et al. 2018 (EPCG), with which the paper's tables of distances were measured.

Mean unsquared nearest distance from predicted to true points and back, x100, in the data set's own scale, over all
views of each test object. The true points are all that the data set has, 100,000 and the vertices in EPCG's clouds.
EPCG itself estimates both means from 200 random points; here all points count.
"""

from pathlib import Path
from typing import Final

import numpy as np

from model.data.manifest import Entry, Manifest, Split
from model.data.shapenet.convert import DENSE
from model.evaluation.classes import class_of
from model.evaluation.conditions import png
from model.evaluation.evaluate import PREDICTED_POINTS, Answer, in_threads
from model.evaluation.paper.record import PaperRecord, Trial, rounded
from model.evaluation.records import Decoder
from model.metrics import nearest_distances
from model.provenance import provenance

EXPERIMENT: Final = "epcg"
FIGURES: Final = ("cd_forward", "cd_backward")


def measure_epcg(
    name: str, answer: Answer, decoder: Decoder, data: Path, split: Split = "test", seed: int = 0
) -> PaperRecord:
    """Measure a method on all views of a split's objects.

    Raises
    ------
    FileNotFoundError : no data set, or an empty split.
    """
    entries = list(Manifest.read(data).of(split))
    if not entries:
        raise FileNotFoundError(f"{data} holds no objects of the split {split}")

    def distances(entry: Entry) -> tuple[float, float, int, int]:
        with np.load(data / entry.file) as arrays:
            true, views = arrays.get(DENSE, arrays["points"]), arrays["views"]
        rows = []
        for view in views:
            predicted = answer(png(view), PREDICTED_POINTS)
            rows.append((nearest_distances(predicted, true).mean(), nearest_distances(true, predicted).mean()))
        forward, backward = 100 * np.mean(rows, axis=0)
        return float(forward), float(backward), len(views), len(true)

    columns = [list(column) for column in zip(*in_threads(distances, entries, f"{name}, EPCG"), strict=True)]
    setting = {
        "split": split,
        "objects": len(entries),
        "views": max(columns[2]),
        "points": PREDICTED_POINTS,
        "true_points": int(np.median(columns[3])),
        "parameters": decoder.parameters,
        "layers": decoder.layers,
    }
    trial = Trial(name, {figure: rounded(column) for figure, column in zip(FIGURES, columns, strict=False)})
    ids, classes = [entry.id for entry in entries], [class_of(entry) for entry in entries]
    return PaperRecord(EXPERIMENT, setting, {"model": name, **provenance(seed)}, ids, classes, [trial])
