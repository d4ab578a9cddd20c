"""Evaluate an exported encoder on a split, along the path that a user's bytes take.

Each view becomes a PNG; `service.images` decodes and frames it, `service.encoder` runs the ONNX file,
`service.sampler` draws the points. Beside it stand two answers that need no image.
"""

import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image
from tqdm import tqdm

from model.data.manifest import Entry, Manifest, Split
from model.metrics import NAMES, compare
from service.encoder import Encoder
from service.images import preprocess
from service.sampler import sample

Floats = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]

VIEWS: Final = (1, 7, 13, 19)  # of 24: one in each quarter turn
POINTS: Final = 10_000  # predicted, against all 10,000 true ones


@dataclass(frozen=True)
class Case:
    """One object of a split: its views (24, S, S, 4) uint8 and its true points (10000, 3)."""

    entry: Entry
    views: Bytes
    points: Floats


@dataclass(frozen=True)
class Evaluation:
    """Figures of one method: `values[object id][metric]`, the mean over that object's views."""

    method: str
    values: dict[str, dict[str, float]]

    def column(self, metric: str) -> npt.NDArray[np.float64]:
        """The metric of every object, in manifest order, (objects,)."""
        return np.array([figures[metric] for figures in self.values.values()])


def cases(data: Path, split: Split) -> Iterator[Case]:
    """The objects of a split in manifest order. Raises FileNotFoundError without a data set."""
    for entry in Manifest.read(data).of(split):
        with np.load(data / entry.file) as arrays:
            yield Case(entry, arrays["views"], arrays["points"])


def predict(encoder: Encoder, view: Bytes, n: int = POINTS) -> Floats:
    """Points of the object in one view, as the service would answer: (S, S, 4) uint8 -> (n, 3)."""
    png = io.BytesIO()
    Image.fromarray(view).save(png, format="PNG")
    framed = preprocess(png.getvalue(), encoder.framing)
    theta = encoder.encode(framed.tensor)[0]
    return np.concatenate(list(sample(encoder.spec, [theta] * encoder.spec.k, n)))


def evaluate(encoder: Encoder, data: Path, split: Split, seed: int = 0) -> list[Evaluation]:
    """The encoder, the mean shape and a random training shape on every object of a split.

    The mean shape is POINTS drawn from all training objects' points together.
    """
    training = list(Manifest.read(data).of("train"))
    rng = np.random.default_rng(seed)
    pool = _pool(data, training, rng)
    methods: dict[str, Callable[[Case], list[Floats]]] = {
        encoder.name: lambda case: [predict(encoder, case.views[view]) for view in VIEWS],
        "mean shape": lambda _: [pool],
        "random training shape": lambda _: [_points(data, training[int(rng.integers(len(training)))])],
    }
    found: dict[str, dict[str, dict[str, float]]] = {method: {} for method in methods}
    total = sum(1 for _ in Manifest.read(data).of(split))
    for case in tqdm(cases(data, split), total=total, desc=f"evaluate {split}", unit="object"):
        for method, answer in methods.items():
            views = [compare(predicted, case.points) for predicted in answer(case)]
            found[method][case.entry.id] = {name: float(np.mean([view[name] for view in views])) for name in NAMES}
    return [Evaluation(method, values) for method, values in found.items()]


def _points(data: Path, entry: Entry) -> Floats:
    with np.load(data / entry.file) as arrays:
        points: Floats = arrays["points"]
    return points


def _pool(data: Path, training: list[Entry], rng: np.random.Generator) -> Floats:
    """POINTS drawn from the union of all training clouds."""
    share = -(-POINTS // len(training))
    drawn = np.concatenate([rng.permutation(_points(data, entry))[:share] for entry in training])
    return rng.permutation(drawn)[:POINTS]
