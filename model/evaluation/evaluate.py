"""Measure predicted points on a split, along the path of a user's bytes.

Each view becomes a PNG; `service.encoding` decodes and frames it and runs the ONNX file, `service.mapping.sampler`
draws the points. They are the function's own numbers (the service's `frame=raw`): the true points have a longest side
of 1, so a function of the wrong size counts as an error. The object frame, in which points are served by default,
would hide that. Objects are measured in threads; each figure is a mean over the views of an object.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

import numpy as np
import numpy.typing as npt
from tqdm import tqdm

from model.data.manifest import COLORS, Entry, Manifest, Split
from model.evaluation.conditions import Condition, condition_views, png
from model.metrics import NAMES, compare
from service.encoding.encoder import Encoder
from service.encoding.framing import Framed, Framing, preprocess
from service.encoding.masks import MattingFunction
from service.errors import NoObjectFound
from service.mapping.sampler import Sampler
from service.mapping.spec import Functions, MappingSpec, word_of

Floats = npt.NDArray[np.float32]
Values = npt.NDArray[np.float64]
Bytes = npt.NDArray[np.uint8]
Answer = Callable[[bytes, int], Floats]  # an image file's bytes, n -> points (n, 3)
Number = TypeVar("Number", bound=np.generic)
S = TypeVar("S")
T = TypeVar("T")

VIEWS: Final = (1, 7, 13, 19)  # of 24: one in each quarter turn
PREDICTED_POINTS: Final = 10_000  # against all 10,000 true ones


@dataclass(frozen=True)
class Case:
    """One object of a split.

    views : (24, S, S, 4) uint8 RGBA; other data sets may have fewer.
    points : (10000, 3) float32, the true points, object frame.
    colors : (10000, 3) uint8, sRGB of the points; (0, 3) if the data set has none.
    cameras : (24, 2) float32, azimuth and elevation in degrees; empty if the data set does not tell.
    """

    entry: Entry
    views: Bytes
    points: Floats
    colors: Bytes
    cameras: Floats


@dataclass(frozen=True)
class Evaluation:
    """Figures of one method: `figures[metric]` holds one value per object, in manifest order.

    condition, n : condition of the images, and number of predicted points.
    """

    method: str
    figures: dict[str, Values]
    condition: Condition = "plain"
    n: int = PREDICTED_POINTS

    def column(self, metric: str) -> Values:
        """Return the metric of every object, (objects,)."""
        return self.figures[metric]


def cases(data: Path, split: Split) -> Iterator[Case]:
    """Yield the objects of a split in manifest order.

    Raises
    ------
    FileNotFoundError : `data` holds no finished data set.
    """
    for entry in Manifest.read(data).of(split):
        with np.load(data / entry.file) as arrays:
            cameras = arrays.get("cameras", np.empty((0, 2), np.float32))
            colors = arrays.get(COLORS, np.empty((0, 3), np.uint8))
            yield Case(entry, arrays["views"], arrays["points"], colors, cameras)


def encoder_answer(encoder: Encoder, matting: MattingFunction | None = None) -> Answer:
    """Return a function that answers as the service would with this encoder and this matting."""

    def answer(photo: bytes, n: int) -> Floats:
        return draw(encoder.spec, encode_photo(encoder, photo, matting).theta, n)

    return answer


def encode_photo(encoder: Encoder, photo: bytes, matting: MattingFunction | None = None) -> Functions:
    """Encode an image file as the service would."""
    return encoder.encode_photo(framed(photo, encoder.framing, matting))


def framed(photo: bytes, framing: Framing, matting: MattingFunction | None = None) -> Framed:
    """Frame an image file as the service does; where it finds no object, as with `background=keep`."""
    try:
        return preprocess(photo, framing, matting=matting)
    except NoObjectFound:
        return preprocess(photo, framing, "keep")


def draw(spec: MappingSpec, theta: Floats, n: int = PREDICTED_POINTS) -> Floats:
    """Draw n points of a mapping function as the service does with `frame=raw`: (n, 3)."""
    return Sampler(spec, word_of(spec, theta)).points(n)


def predict(encoder: Encoder, view: Bytes, n: int = PREDICTED_POINTS) -> Floats:
    """Predict points of the object in one view, as the service would: (S, S, 4) uint8 -> (n, 3)."""
    return encoder_answer(encoder)(png(view), n)


def measure(
    method: str,
    answer: Answer,
    objects: Sequence[Case],
    data: Path,
    condition: Condition = "plain",
    counts: Sequence[int] = (PREDICTED_POINTS,),
    seed: int = 0,
) -> list[Evaluation]:
    """Measure a method that looks at images; return one evaluation per count of points.

    Points are drawn once, at the largest count: the first n are the answer for n, as sampling is prefix-stable.

    Raises
    ------
    FileNotFoundError : the condition's images are not rendered.
    """

    def figures(case: Case) -> list[dict[str, float]]:
        photos = condition_views(data, case.entry, condition, chosen_views(case.views), seed)
        answers = [answer(photo, max(counts)) for photo in photos]
        return [_mean([compare(points[:n], case.points) for points in answers]) for n in counts]

    rows = in_threads(figures, objects, f"{method}, {condition}")
    return [
        Evaluation(method, _columns(figures_at_n), condition, n)
        for n, figures_at_n in zip(counts, zip(*rows, strict=True), strict=True)
    ]


def measure_objects(
    method: str, figures: Callable[[Case], dict[str, float]], objects: Sequence[Case], n: int = PREDICTED_POINTS
) -> Evaluation:
    """Measure a method that looks at no image: a reference or a bound."""
    return Evaluation(method, _columns(in_threads(figures, objects, method)), n=n)


def chosen_views(views: npt.NDArray[Number]) -> npt.NDArray[Number]:
    """Return the views that are evaluated, or their numbers: VIEWS, or all of an object that has fewer."""
    return views[list(VIEWS)] if len(views) > max(VIEWS) else views


def in_threads(work: Callable[[S], T], objects: Sequence[S], description: str) -> list[T]:
    """Return `work(object)` for all objects, in order; `description` labels the progress bar."""
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        return list(tqdm(threads.map(work, objects), total=len(objects), desc=description, unit="object", disable=None))


def _mean(views: Sequence[dict[str, float]]) -> dict[str, float]:
    return {name: float(np.mean([view[name] for view in views])) for name in NAMES}


def _columns(rows: Sequence[dict[str, float]]) -> dict[str, Values]:
    return {name: np.array([row[name] for row in rows]) for name in NAMES}
