"""Measure the trained variants of a suite on a split: one figure per object, means over its views and the seeds."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from torch import nn

from model.config import TrainConfig
from model.data.dataset import Shape
from model.data.manifest import Entry, Manifest, Split
from model.data.shapenet.convert import DENSE
from model.evaluation.classes import class_of
from model.evaluation.comparison import ORACLE, RETRIEVAL, references
from model.evaluation.conditions import png
from model.evaluation.evaluate import PREDICTED_POINTS, chosen_views, in_threads
from model.evaluation.paper.record import PaperRecord, Trial, rounded
from model.evaluation.paper.suites import CD, TRAVEL
from model.evaluation.timing import network_decoder
from model.metrics import NAMES, compare
from model.networks.decoders import Hof
from model.networks.encoder import predicted_mask
from model.provenance import provenance
from model.training.checkpoints import chosen_checkpoint, load_network, predictor
from service.encoding.framing import preprocess
from service.mapping.canonical import canonical_points

CURVE: Final = "f@1%"  # of validation, in the log

Floats = npt.NDArray[np.float32]
Values = npt.NDArray[np.float64]


def measure_suite(
    experiment: str,
    runs: Mapping[tuple[str, int], Path],
    data: Path,
    split: Split = "test",
    every_view: bool = False,
    with_references: bool = False,
) -> PaperRecord:
    """Measure finished runs, by variant and seed.

    Parameters
    ----------
    every_view : measure all views against all true points, as EPCG's protocol does.
    with_references : measure image retrieval and the oracle nearest neighbor too.

    Raises
    ------
    FileNotFoundError : no data set, or a run without a checkpoint.
    """
    entries = list(Manifest.read(data).of(split))
    names, seeds = list(dict.fromkeys(name for name, _ in runs)), sorted({seed for _, seed in runs})
    trials, about = [], {}
    for name in names:
        columns = []
        for seed in seeds:
            network, config, state = load_network(chosen_checkpoint(runs[name, seed]))
            columns.append(_figures(network, config, f"{name}, seed {seed}", data, entries, every_view, seed))
            if seed == seeds[0]:
                about[name] = _about(runs[name, seed], network, config, state)
        figures = {figure: rounded(np.mean([column[figure] for column in columns], axis=0)) for figure in columns[0]}
        trials.append(Trial(name, figures))
    if with_references:
        trials += _references(data, split, seeds[0])
    setting: dict[str, Any] = {"split": split, "objects": len(entries), "points": PREDICTED_POINTS}
    setting |= {"every_view": every_view, "seeds": seeds, "variants": about}
    ids, classes = [entry.id for entry in entries], [class_of(entry) for entry in entries]
    return PaperRecord(experiment, setting, provenance(seeds[0]), ids, classes, trials)


def _figures(
    network: nn.Module,
    config: TrainConfig,
    title: str,
    data: Path,
    entries: Sequence[Entry],
    every_view: bool,
    seed: int,
) -> dict[str, Values]:
    """Return each figure of a run, (objects,); `title` stands before the progress bar."""
    predict, domain = predictor(network, config), config.spec.domain
    start = canonical_points(domain, PREDICTED_POINTS, seed)

    def figures(entry: Entry) -> dict[str, float]:
        with np.load(data / entry.file) as arrays:
            views, points, cameras = arrays["views"], arrays["points"], arrays.get("cameras")
            shape = Shape(views, arrays.get(DENSE, points) if every_view else points, None, cameras)
        rows = []
        for view in range(len(views)) if every_view else chosen_views(np.arange(len(views))):
            photo = preprocess(png(views[view]), config.framing).tensor
            points = predict(photo, PREDICTED_POINTS, seed)[0]
            row = compare(points, shape.points_in(config.frame, int(view)))
            row[CD] = (row["cd_forward"] + row["cd_backward"]) / 2
            if config.method == "hof" and start.shape[1] == points.shape[1]:
                row[TRAVEL] = float(np.linalg.norm(points - start, axis=1).mean())
            rows.append(row)
        return {figure: float(np.mean([row[figure] for row in rows])) for figure in rows[0]}

    rows = in_threads(figures, entries, title)
    return {figure: np.array([row[figure] for row in rows]) for figure in rows[0]}


def _references(data: Path, split: Split, seed: int) -> list[Trial]:
    """Measure the methods that need no training."""
    trials = []
    for each in references(data, split, seed):
        if each.method in (RETRIEVAL, ORACLE):
            figures = {name: each.column(name) for name in NAMES}
            figures[CD] = (figures["cd_forward"] + figures["cd_backward"]) / 2
            trials.append(Trial(each.method, {name: rounded(values) for name, values in figures.items()}))
    return trials


def _about(run: Path, network: nn.Module, config: TrainConfig, state: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the page says about a run: its size, steps, images, the end of its curve."""
    decoder = network_decoder(network, config)
    predicted = 0
    if isinstance(network, Hof):
        predicted = int(predicted_mask(config.spec, config.encoder.predicted).sum())
    records = [json.loads(line) for line in (run / "log.jsonl").read_text(encoding="utf-8").splitlines()]
    curve = [[record["step"], round(record[CURVE], 4)] for record in records if CURVE in record]
    return {
        "parameters": decoder.parameters,
        "predicted": predicted,
        "layers": decoder.layers,
        "ms": decoder.ms,
        "steps": records[-1]["step"] if records else state["step"],
        "batch": config.batch,
        "minutes": round(state["elapsed_s"] / 60, 1),
        "trunk": config.encoder.trunk,
        "size": config.framing.size,
        "augmented": config.augmented,
        "curve": curve,
    }
