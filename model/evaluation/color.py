"""How far predicted colours are from the true ones, beside what takes no training.

An error is the mean absolute difference per channel, 0 to 255: `color_forward` from each predicted point to its
nearest true one, `color_backward` from each true point to its nearest predicted one. Constant colours and the
bound stand on the model's own points, so that colour alone is compared.
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
from model.evaluation.evaluate import POINTS, VIEWS, Case, Evaluation, cases, draw, in_threads
from model.evaluation.records import Record
from model.evaluation.references import Retrieval, Training
from model.provenance import provenance
from service.encoding.decode import decode
from service.encoding.encoder import Encoder
from service.encoding.framing import frame, over_white
from service.mapping.color import ColorSampler

Floats = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]
Indices = npt.NDArray[np.int64]
Values = npt.NDArray[np.float64]

NAMES: Final = ("color_forward", "color_backward")
PHOTO_MEAN: Final = "mean colour of the object's pixels"
BRIGHTER: Final = 1.35  # materials than their renders, about
PHOTO_BRIGHTENED: Final = f"that colour, {BRIGHTER} times as bright"
GREY: Final = "grey"
BOUND: Final = "true colours at the predicted points"
MIDDLE: Final = 128


def color_record(encoder: Encoder, data: Path, split: Split, seed: int) -> Record:
    """An exported encoder's colours on a split, and the references'.

    Raises
    ------
    FileNotFoundError : no data set.
    """
    objects, retrieval = list(cases(data, split)), Retrieval(data, Training.read(data))

    def figures(case: Case) -> dict[str, dict[str, float]]:
        views = [_view_errors(encoder, retrieval, case, png(view)) for view in case.views[list(VIEWS)]]
        return {
            method: {name: float(np.mean([view[method][name] for view in views])) for name in NAMES}
            for method in views[0]
        }

    rows = in_threads(figures, objects, "colours")
    evaluations = tuple(
        Evaluation(method, {name: np.array([row[method][name] for row in rows]) for name in NAMES})
        for method in rows[0]
    )
    made = {"digest": encoder.digest, "training": encoder.card.get("color", {}), **provenance(seed)}
    return Record(encoder.name, split, None, made, tuple(case.entry.id for case in objects), evaluations)


def _view_errors(encoder: Encoder, retrieval: Retrieval, case: Case, photo: bytes) -> dict[str, dict[str, float]]:
    """method -> its two errors, for one photo of the object."""
    crop = frame(decode(photo), encoder.framing).rgba
    functions = encoder.encode(over_white(crop))[0]
    if functions.color is None:
        raise ValueError(f"the model {encoder.name} has no colour: train it with `hof-model color`, export again")
    pairs = _pairs(draw(encoder.spec, functions.theta), case.points)
    found, found_colours = retrieval.surface(photo)
    mean = object_mean(crop)
    constants = {PHOTO_MEAN: mean, PHOTO_BRIGHTENED: np.minimum(BRIGHTER * mean, 255), GREY: np.full(3, MIDDLE)}
    return {
        encoder.name: _errors(pairs, ColorSampler(functions.color).colors(POINTS), case.colours),
        **{name: _errors(pairs, np.broadcast_to(one, (POINTS, 3)), case.colours) for name, one in constants.items()},
        RETRIEVAL: _errors(_pairs(found, case.points), found_colours, case.colours),
        BOUND: _errors(pairs, case.colours[pairs[0]], case.colours),
    }


def object_mean(crop: Image.Image) -> Values:
    """Mean colour of the object in an RGBA image, its pixels weighted by alpha: (3,), 0 to 255."""
    pixels = np.asarray(crop, np.float64).reshape(-1, 4)
    return np.average(pixels[:, :3], axis=0, weights=pixels[:, 3])


def _pairs(points: Floats, true: Floats) -> tuple[Indices, Indices]:
    """Index of the nearest true point of each point (n,), and of the nearest point of each true one (m,)."""
    forward: Indices = cKDTree(true).query(points)[1]
    backward: Indices = cKDTree(points).query(true)[1]
    return forward, backward


def _errors(pairs: tuple[Indices, Indices], colours: npt.NDArray[Any], true: Bytes) -> dict[str, float]:
    forward, backward = pairs
    given, wanted = colours.astype(np.float32), true.astype(np.float32)
    errors = (np.abs(given - wanted[forward]).mean(), np.abs(given[backward] - wanted).mean())
    return dict(zip(NAMES, map(float, errors), strict=True))
