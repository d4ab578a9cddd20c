"""Picture of the projection experiment: slices of the canonical ball, and where the functions send them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from model.data.manifest import Manifest, Split
from model.evaluation.conditions import png
from model.evaluation.evaluate import VIEWS
from model.training.checkpoints import chosen_checkpoint, load_network, predictor
from service.drawing.words import Cell, sheet
from service.encoding.framing import preprocess
from service.mapping.canonical import canonical_points

POINTS: Final = 6_000
SLICES: Final = 4  # along x, each of an equal share of the points
CELL: Final = 160  # pixels
GRAY: Final = (205, 205, 205)
FROM: Final = (200, 60, 50)  # a slice of the ball
TO: Final = (40, 140, 70)  # where it lands

Floats = npt.NDArray[np.float32]


def draw_slices(runs: Mapping[tuple[str, int], Path], data: Path, split: Split = "test") -> Image.Image:
    """Draw a row for each variant of the first seed: the slices of the ball, then each slice's place in the object.

    The object is the split's first one.

    Raises
    ------
    FileNotFoundError : no data set, or a run without a checkpoint.
    """
    entry = next(Manifest.read(data).of(split))
    with np.load(data / entry.file) as arrays:
        views = arrays["views"]
    photo = png(views[min(VIEWS[0], len(views) - 1)])
    seed = min(seed for _, seed in runs)
    rows = []
    for name, run in ((name, run) for (name, each), run in runs.items() if each == seed):
        network, config, _ = load_network(chosen_checkpoint(run))
        points = predictor(network, config)(preprocess(photo, config.framing).tensor, POINTS, seed)[0]
        rows.append(cells(name, canonical_points(config.spec.domain, POINTS, seed), points))
    return sheet(rows, cell=CELL)


def cells(name: str, canonical: Floats, points: Floats) -> list[Cell]:
    """Return two pictures of each slice: in the ball, half its size, and in the object; canonical, points (n, 3)."""
    order = np.argsort(canonical[:, 0])
    row: list[Cell] = []
    for number, chosen in enumerate(np.array_split(order, SLICES)):
        for cloud, color, label in ((canonical / 2, FROM, "ball"), (points, TO, "object")):
            colors = np.full((len(cloud), 3), GRAY, np.uint8)
            colors[chosen] = color
            row.append((f"{name}: {label}, slice {number + 1}", cloud.astype(np.float32), colors))
    return row
