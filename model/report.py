"""RESULTS.md, its picture and the raw metrics behind it, all from one evaluation."""

import json
from pathlib import Path
from typing import Final

import numpy as np
from PIL import Image, ImageDraw

from model.card import figures
from model.data.manifest import Manifest, Split
from model.data.preview import flatten
from model.evaluate import POINTS, VIEWS, Case, Evaluation, cases, evaluate, predict
from model.metrics import NAMES
from model.provenance import provenance
from service.encoder import Encoder
from service.picture import draw

CELL: Final = 160
LABEL: Final = 16
SHOWN: Final = 24  # objects, the first of the split in manifest order
COLUMNS: Final = 2  # objects side by side


def report(encoder: Encoder, data: Path, split: Split, root: Path, seed: int = 0) -> list[Evaluation]:
    """Evaluate, then write `root/RESULTS.md`, `root/model/results/<model>.json` and `.png`."""
    evaluations = evaluate(encoder, data, split, seed)
    folder = root / "model" / "results"
    folder.mkdir(parents=True, exist_ok=True)
    raw = {
        "model": encoder.name,
        "digest": encoder.digest,
        "split": split,
        **provenance(seed),
        "config": encoder.card.get("training", {}),
        "objects": {found.method: found.values for found in evaluations},
    }
    (folder / f"{encoder.name}.json").write_text(json.dumps(raw, indent=1) + "\n", encoding="utf-8")
    contact_sheet(encoder, data, split).save(folder / f"{encoder.name}.png", optimize=True)
    (root / "RESULTS.md").write_text(_markdown(encoder, data, split, evaluations, seed), encoding="utf-8")
    return evaluations


def table(evaluations: list[Evaluation]) -> str:
    """Methods by metrics, mean and 95% bootstrap interval over objects, as Markdown."""
    lines = [f"| method | {' | '.join(NAMES)} |", f"|---|{'---|' * len(NAMES)}"]
    for method, values in figures(evaluations).items():
        cells = [f"{mean:.3f} ({low:.3f} to {high:.3f})" for mean, low, high in (values[name] for name in NAMES)]
        lines.append(f"| {method} | {' | '.join(cells)} |")
    return "\n".join(lines)


def contact_sheet(encoder: Encoder, data: Path, split: Split) -> Image.Image:
    """Image, truth and prediction of the split's first objects, in manifest order."""
    shown = [case for case, _ in zip(cases(data, split), range(SHOWN), strict=False)]
    rows = -(-len(shown) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * 3 * CELL, rows * (CELL + LABEL)), "white")
    pen = ImageDraw.Draw(sheet)
    for index, case in enumerate(shown):
        left, top = index % COLUMNS * 3 * CELL, index // COLUMNS * (CELL + LABEL)
        pen.text((left + 2, top), f"{case.entry.id}: image, truth, prediction", fill="black")
        for column, cell in enumerate(_cells(encoder, case)):
            sheet.paste(cell, (left + column * CELL, top + LABEL))
    return sheet


def _cells(encoder: Encoder, case: Case) -> list[Image.Image]:
    view = case.views[VIEWS[0]]
    clouds = (case.points, predict(encoder, view))
    return [Image.fromarray(flatten(view)).resize((CELL, CELL))] + [Image.fromarray(draw(c, CELL)) for c in clouds]


def _markdown(encoder: Encoder, data: Path, split: Split, evaluations: list[Evaluation], seed: int) -> str:
    manifest = Manifest.read(data)
    made = provenance(seed)
    objects = sum(1 for _ in manifest.of(split))
    model, mean_shape = evaluations[0], evaluations[1]
    summed = [float(np.mean(found.column("cd_forward") + found.column("cd_backward"))) for found in (model, mean_shape)]
    return f"""# Results

Written by `make results`: the shipped weights, evaluated along the path of a user's bytes (PNG, `service.images`,
the ONNX file, the sampler).

- Machine: {made["machine"]}. Date: {made["date"]}. Seed: {made["seed"]}. Commit: {made["commit"]}.
- Data: Sweet Home 3D furniture, {split} split, {objects} objects that no training object repeats, views
  {", ".join(map(str, VIEWS))} of 24; {POINTS:,} predicted against 10,000 true points.
- Model: `{encoder.name}`, sha256 {encoder.digest[:16]}. Training: {encoder.card["training"]["steps"]:,} steps in
  {encoder.card["training"]["minutes"]} minutes.

## Test split

Mean over objects, with the 95% bootstrap interval over objects. `cd_forward` and `cd_backward` are cd_epcg, the mean
unsquared nearest distance predicted -> true and true -> predicted, x100 of the longest side; `cd_sq` is the sum of both
squared, x100; `f@t` is the F-score at t of the longest side.

{table(evaluations)}

Summed cd_epcg: {summed[0]:.2f}, against {summed[1]:.2f} for the mean shape: {summed[1] / summed[0]:.2f} times better.
The mean shape is {POINTS:,} points of all training objects together; the random training shape is drawn anew for each
test object.

## Pictures

The first {min(SHOWN, objects)} test objects in manifest order: the image that went in (view {VIEWS[0]}), the true
points, the predicted points, both seen from 30 degrees to the side and 22 degrees above.

![image, truth, prediction](model/results/{encoder.name}.png)
"""
