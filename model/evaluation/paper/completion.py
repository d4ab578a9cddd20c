"""Experiment 12: encoders of points, parts of surfaces in, whole objects out, along the path of a user's points.

`service.encoding.completion` encodes a part with its front on each side and chooses; the points of the function go back
to the frame of the part, and are compared with the true ones there. Distances are in longest sides of the whole object.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
import torch
from PIL import Image

from model.data.manifest import Split
from model.data.rendering.partial import fixed_parts
from model.evaluation.classes import class_of
from model.evaluation.evaluate import (
    PREDICTED_POINTS,
    Case,
    Evaluation,
    Floats,
    cases,
    draw,
    in_threads,
    measure_objects,
)
from model.evaluation.paper.record import PaperRecord, Trial, rounded
from model.metrics import NAMES, compare
from model.provenance import provenance
from service.drawing.words import sheet
from service.encoding import completion
from service.encoding.encoder import Encoder
from service.mapping.refinement import STEPS

EXPERIMENT: Final = "points"
PARTS: Final = 4  # of each object, as in training
SHARES: Final = (0.25, 0.5, 0.75, 1.0)  # of the surface, seen on one side of a plane
COUNTS: Final = (64, 256, 1_024, 2_048)  # points of a part
SHOWN: Final = 8  # objects of the picture
CELL: Final = 240  # pixels
COMPLETED: Final = "completed"
ENCODED: Final = "encoded, not fitted"
ALONE: Final = "the part alone"

Part = Callable[[Case, int], Floats]  # an object and the number of the part -> points of it (n, 3), object frame


def complete(encoder: Encoder, part: Floats, n: int = PREDICTED_POINTS, steps: int = STEPS) -> Floats:
    """Return n points of the whole object, fitted in `steps`, in the frame and the unit of the part (m, 3)."""
    sent, functions = completion.complete(encoder, part, steps)
    return sent.place(draw(encoder.spec, functions.theta, n)).astype(np.float32)


def training_part(case: Case, number: int) -> Floats:
    """Return a part as in training: on one side of a plane or seen by a camera, 64 to 2,048 noisy points."""
    parts = fixed_parts(torch.from_numpy(case.points)[None], number)
    points: Floats = (parts.clouds * parts.scale + parts.center)[0].numpy()
    return np.unique(points, axis=0)  # parts repeat their points


def measure_completion(
    encoder: Encoder, data: Path, split: Split, seed: int = 0, part: Part = training_part
) -> Evaluation:
    """Measure an encoder of points on PARTS parts of every object of a split.

    Raises
    ------
    FileNotFoundError : `data` holds no finished data set.
    """

    def figures(case: Case) -> dict[str, float]:
        each = [compare(complete(encoder, part(case, seed + number)), case.points) for number in range(PARTS)]
        return {name: float(np.mean([one[name] for one in each])) for name in NAMES}

    return measure_objects(encoder.name, figures, list(cases(data, split)))


def measure_points(model: Path, data: Path, split: Split, seed: int = 0) -> PaperRecord:
    """Measure completion by the share of the surface that is seen, and by the number of points.

    Raises
    ------
    FileNotFoundError : no data set.
    ValueError : the model takes images.
    """
    encoder, objects = Encoder.open(model, threads=1), list(cases(data, split))
    if encoder.takes != "points":
        raise ValueError(f"the model {model} takes images: name one of `hof-model train --trunk grid`")

    def figures(case: Case) -> dict[str, dict[str, float]]:
        return {
            trial_name(method, share, count): compare(points, case.points)
            for share, count in pairs()
            for method, points in _answers(encoder, cut_of(case, share, count, seed)).items()
        }

    rows = in_threads(figures, objects, "points")
    setting = {"split": split, "objects": len(objects), "points": PREDICTED_POINTS}
    origin = {"model": encoder.name, "digest": encoder.digest, **provenance(seed)}
    trials = [
        Trial(name, {metric: rounded([row[name][metric] for row in rows]) for metric in NAMES}) for name in rows[0]
    ]
    ids, classes = [case.entry.id for case in objects], [class_of(case.entry) for case in objects]
    return PaperRecord(EXPERIMENT, setting, origin, ids, classes, trials)


def draw_completed(model: Path, data: Path, split: Split, seed: int = 0) -> Image.Image:
    """Draw the split's first objects, a row each: a part of half of the surface, the completed object, the true one."""
    encoder, rows = Encoder.open(model, threads=1), []
    for case in list(cases(data, split))[:SHOWN]:
        part, name = cut_of(case, SHARES[1], COUNTS[-1], seed), case.entry.id.rpartition("/")[2]
        clouds = ((f"{name}: part", part), (COMPLETED, complete(encoder, part)), ("true object", case.points))
        rows.append([(label, points, None) for label, points in clouds])
    return sheet(rows, cell=CELL)


def pairs() -> list[tuple[float, int]]:
    """Return the shares and counts that are measured: all shares at most points, all counts at half of the surface."""
    return [*((share, COUNTS[-1]) for share in SHARES), *((SHARES[1], count) for count in COUNTS[:-1])]


def trial_name(method: str, share: float, count: int) -> str:
    """Return the name of a method with a share and a count of points in the record."""
    return f"{method}, {share:.0%}, {count} points"


def cut_of(case: Case, share: float, count: int, seed: int) -> Floats:
    """Return a part of an object as `cut` does, on a side of its own."""
    return cut(case.points, share, count, [seed, *case.entry.id.encode()])


def cut(points: Floats, share: float, count: int, seed: int | list[int]) -> Floats:
    """Return `count` points of the `share` of a surface on one side of a random plane, the same for the same seed."""
    rng = np.random.default_rng(seed)
    heights = points @ rng.standard_normal(3)
    kept = points[heights >= np.quantile(heights, 1 - share)]
    return kept[rng.permutation(len(kept))[:count]]


def _answers(encoder: Encoder, part: Floats) -> dict[str, Floats]:
    """Return the points of each method, given a part."""
    return {COMPLETED: complete(encoder, part), ENCODED: complete(encoder, part, steps=0), ALONE: part}
