"""Experiment 11: several views of one object, aggregated into one shape.

The functions of v views are composed (words of neighboring views, which share the points evenly), their thetas are
averaged, or their codes, the tensor before the encoder's last layer. A count v is measured on all sets of v views in
even steps around the object, so that every count uses the same eight photos. Points are the function's own numbers.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import onnx
from onnx.utils import Extractor

from model.data.manifest import Split
from model.evaluation.classes import class_of
from model.evaluation.conditions import png
from model.evaluation.evaluate import PREDICTED_POINTS, Case, cases, in_threads
from model.evaluation.paper.record import PaperRecord, Trial, rounded
from model.metrics import NAMES, compare
from model.networks.inner import THETA, InnerEncoder, inner_tensors
from model.provenance import provenance
from service.encoding.encoder import Encoder
from service.encoding.framing import preprocess
from service.encoding.network import open_session
from service.mapping.sampler import Sampler
from service.mapping.spec import MappingSpec, word_of

EXPERIMENT: Final = "views"
VIEWS: Final = (1, 4, 7, 10, 13, 16, 19, 22)  # of the ring of 24
COUNTS: Final = (1, 2, 4, 8)
ONE: Final = "one view"
COMPOSED: Final = "composed functions"
THETAS: Final = "mean of thetas"
CODES: Final = "mean of codes"
UNION: Final = "clouds of all views together"
MEDOID: Final = "view nearest to the mean theta"

Floats = npt.NDArray[np.float32]
Aggregate = Callable[[Floats, Floats], Floats]  # thetas (v, size), codes (v, width) -> points (n, 3)
Figures = dict[str, dict[str, float]]  # method -> metric -> mean over the sets of views


def measure_views(model: Path, data: Path, split: Split, seed: int = 0) -> PaperRecord:
    """Measure each way to aggregate on every object of a split.

    Raises
    ------
    FileNotFoundError : no data set.
    ValueError : the model was not written by `hof-model export`.
    """
    encoder, objects = Encoder.open(model, threads=1), list(cases(data, split))
    inner, head = InnerEncoder(model, threads=1), Head(model)
    ways = aggregates(encoder.spec, head)
    gaps: list[float] = []

    def figures(case: Case) -> Figures:
        photos = [preprocess(png(case.views[view]), encoder.framing).tensor for view in VIEWS]
        thetas, tensors = inner.look(np.concatenate(photos))
        codes = tensors["code"]
        gaps.append(float(np.abs(head(codes.mean(axis=0)) - thetas.mean(axis=0)).max()))
        return figures_of(ways, thetas, codes, case.points)

    rows = in_threads(figures, objects, "views")
    setting = {"split": split, "objects": len(objects), "views": VIEWS, "points": PREDICTED_POINTS, "gap": max(gaps)}
    origin = {"model": encoder.name, "k": encoder.spec.k, "digest": encoder.digest, **provenance(seed)}
    trials = [
        Trial(method, {name: rounded([row[method][name] for row in rows]) for name in NAMES}) for method in rows[0]
    ]
    ids, classes = [case.entry.id for case in objects], [class_of(case.entry) for case in objects]
    return PaperRecord(EXPERIMENT, setting, origin, ids, classes, trials)


def figures_of(ways: Mapping[str, Aggregate], thetas: Floats, codes: Floats, true: Floats) -> Figures:
    """Return the metrics of one object by method and count of views, means over the sets of views.

    Parameters
    ----------
    thetas, codes : (8, size) and (8, width), in order around the object.
    """
    figures: Figures = {}
    for count in COUNTS:
        step = len(thetas) // count
        sets = [list(range(start, len(thetas), step)) for start in range(step)]
        for method, aggregate in ({ONE: ways[THETAS]} if count == 1 else ways).items():
            rows = [compare(aggregate(thetas[views], codes[views]), true) for views in sets]
            figures[trial_name(method, count)] = {name: float(np.mean([row[name] for row in rows])) for name in NAMES}
    return figures


def trial_name(method: str, count: int) -> str:
    """Return the name of a method with a count of views in the record."""
    return method if count == 1 else f"{method}, {count} views"


def aggregates(spec: MappingSpec, head: Callable[[Floats], Floats]) -> dict[str, Aggregate]:
    """Return the ways to aggregate, by name.

    Parameters
    ----------
    head : code (width,) -> theta (spec.size,).
    """
    one = partial(_draw, spec)
    return {
        COMPOSED: lambda thetas, _: _share(spec, [words(thetas, spec.k, first) for first in range(len(thetas))]),
        THETAS: lambda thetas, _: one(thetas.mean(axis=0)),
        CODES: lambda _, codes: one(head(codes.mean(axis=0))),
        UNION: lambda thetas, _: _share(spec, list(thetas)),
        MEDOID: lambda thetas, _: one(
            thetas[int(np.square(thetas - thetas.mean(axis=0)).sum(axis=1).argmin())],
        ),
    }


def words(thetas: Floats, k: int, first: int) -> Floats:
    """Return the word of k neighboring views from `first` on, around the object: (v, size) -> (k, size)."""
    word: Floats = thetas[[(first + place) % len(thetas) for place in range(k)]]
    return word


class Head:
    """The encoder's last layer: a code becomes theta."""

    def __init__(self, file: Path) -> None:
        model = onnx.load(file)
        self._code = inner_tensors(model)["code"]
        graph = Extractor(onnx.shape_inference.infer_shapes(model)).extract_model([self._code], [THETA])
        self._session: Any = open_session(graph.SerializeToString(), threads=1)

    def __call__(self, code: Floats) -> Floats:
        """Return theta (size,) of a code (width,)."""
        theta: Floats = self._session.run([THETA], {self._code: code[None]})[0][0]
        return theta


def _share(spec: MappingSpec, thetas: Sequence[Floats]) -> Floats:
    """Draw PREDICTED_POINTS points of several functions or words together, as many of each."""
    return np.concatenate([_draw(spec, theta, PREDICTED_POINTS // len(thetas)) for theta in thetas])


def _draw(spec: MappingSpec, theta: Floats, n: int = PREDICTED_POINTS) -> Floats:
    return Sampler(spec, word_of(spec, theta)).points(n)
