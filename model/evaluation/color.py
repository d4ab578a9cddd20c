"""Measure predicted colors against the true ones, beside references that need no training.

An error is the mean absolute difference per channel, 0 to 255: `color_forward` from each predicted point to its
nearest true one, `color_backward` from each true point to its nearest predicted one. Constant colors and the
bound use the model's own points, so that only color is compared.
"""

from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image
from scipy.spatial import cKDTree

from model.data.manifest import Split
from model.evaluation.comparison import RETRIEVAL
from model.evaluation.conditions import png
from model.evaluation.evaluate import PREDICTED_POINTS, VIEWS, Case, Evaluation, cases, draw, in_threads
from model.evaluation.records import Record
from model.evaluation.references.methods import Retrieval, Training
from model.provenance import provenance
from service.encoding.decode import decode
from service.encoding.encoder import Encoder
from service.encoding.framing import frame
from service.encoding.pixels import over_white
from service.mapping.color import ColorSampler

Floats = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]
Indices = npt.NDArray[np.int64]
Values = npt.NDArray[np.float64]

NAMES: Final = ("color_forward", "color_backward")
PHOTO_MEAN: Final = "mean color of the object's pixels"
BRIGHTER: Final = 1.35  # materials against their renders, about
PHOTO_BRIGHTENED: Final = f"that color, {BRIGHTER} times as bright"
GRAY: Final = "gray"
BOUND: Final = "true colors at the predicted points"
MIDDLE: Final = 128


def color_record(encoder: Encoder, data: Path, split: Split, seed: int) -> Record:
    """Measure the colors of an exported encoder and of the references on a split.

    Raises
    ------
    FileNotFoundError : no data set.
    ValueError : the model has no color head.
    """
    objects, retrieval = list(cases(data, split)), Retrieval(data, Training.read(data))

    def figures(case: Case) -> dict[str, dict[str, float]]:
        views = [_view_errors(encoder, retrieval, case, png(view)) for view in case.views[list(VIEWS)]]
        return {
            method: {name: float(np.mean([view[method][name] for view in views])) for name in NAMES}
            for method in views[0]
        }

    rows = in_threads(figures, objects, "colors")
    evaluations = tuple(
        Evaluation(method, {name: np.array([row[method][name] for row in rows]) for name in NAMES})
        for method in rows[0]
    )
    origin = {"digest": encoder.digest, "training": encoder.card.get("color", {}), **provenance(seed)}
    return Record(encoder.name, split, None, origin, tuple(case.entry.id for case in objects), evaluations)


def _view_errors(encoder: Encoder, retrieval: Retrieval, case: Case, photo: bytes) -> dict[str, dict[str, float]]:
    """Return method -> its two errors, for one photo of the object."""
    crop = frame(decode(photo), encoder.framing).rgba
    functions = encoder.encode(over_white(crop))[0]
    if functions.color is None:
        raise ValueError(f"the model {encoder.name} has no color head: run `hof-model color`, then export it again")
    pairs = _pairs(draw(encoder.spec, functions.theta), case.points)
    match, match_colors = retrieval.surface(photo)
    mean = object_mean(crop)
    constants = {PHOTO_MEAN: mean, PHOTO_BRIGHTENED: np.minimum(BRIGHTER * mean, 255), GRAY: np.full(3, MIDDLE)}
    return {
        encoder.name: _errors(pairs, ColorSampler(functions.color).colors(PREDICTED_POINTS), case.colors),
        **{name: _constant_errors(pairs, value, case.colors) for name, value in constants.items()},
        RETRIEVAL: _errors(_pairs(match, case.points), match_colors, case.colors),
        BOUND: _errors(pairs, case.colors[pairs[0]], case.colors),
    }


def object_mean(crop: Image.Image) -> Values:
    """Return the mean color of the object in an RGBA image, pixels weighted by alpha: (3,), 0 to 255."""
    pixels = np.asarray(crop, np.float64).reshape(-1, 4)
    return np.average(pixels[:, :3], axis=0, weights=pixels[:, 3])


def _pairs(points: Floats, true: Floats) -> tuple[Indices, Indices]:
    """Return the index of the nearest true point of each point (n,), and of the nearest point of each true one (m,)."""
    forward: Indices = cKDTree(true).query(points)[1]
    backward: Indices = cKDTree(points).query(true)[1]
    return forward, backward


def _errors(pairs: tuple[Indices, Indices], colors: npt.NDArray[Any], true: Bytes) -> dict[str, float]:
    forward, backward = pairs
    predicted, expected = colors.astype(np.float32), true.astype(np.float32)
    errors = (np.abs(predicted - expected[forward]).mean(), np.abs(predicted[backward] - expected).mean())
    return dict(zip(NAMES, map(float, errors), strict=True))


def _constant_errors(pairs: tuple[Indices, Indices], color: Values, true: Bytes) -> dict[str, float]:
    """Return the errors of one color (3,) for all points."""
    return _errors(pairs, np.broadcast_to(color, (PREDICTED_POINTS, 3)), true)
