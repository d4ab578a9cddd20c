"""Measure the estimates of an exported model: the confidence in its shapes, and the camera.

Images go along the path of a user's bytes. Objects are those of the data set's split and of sources that no head has
seen; the confidence is compared with the F@2% that evaluation measures. Strange images have no true answer.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from model.data.manifest import Manifest, Split
from model.data.rendering.render import render_parts
from model.evaluation.conditions import photographs, png
from model.evaluation.estimates.observe import SCORE, turned_distances
from model.evaluation.estimates.strange import motorcycle, noise, part_of, side_by_side
from model.evaluation.evaluate import VIEWS, Case, cases, draw, in_threads
from model.metrics import compare
from model.networks.observations import SYMMETRIC
from model.provenance import provenance
from service.encoding.encoder import Encoder
from service.encoding.estimates import Estimates
from service.encoding.framing import Background, preprocess
from service.files import whole_file

Floats = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]
Values = npt.NDArray[np.float64]

ANGLES: Final = ("azimuth", "elevation")
STRANGE_IMAGES: Final = 12  # of each kind
MOTORCYCLE: Final = "a motorcycle of simple bodies"


@dataclass(frozen=True)
class Sightings:
    """One row per object, one value per view.

    source : its name in the tables.
    confidence, scores : (objects, views) shape confidence, and the true F@2%.
    errors : angle -> (objects, views) absolute error, degrees; the azimuth's is the shorter way around.
    has_front : whether the objects' front is known to be at +Z; without it the azimuth's errors mean nothing.
    turned : (objects,) least mean distance of an object's points to itself turned by 45 to 315 degrees, longest sides.
    """

    source: str
    has_front: bool
    ids: list[str]
    confidence: list[list[float]]
    scores: list[list[float]]
    errors: dict[str, list[list[float]]]
    turned: list[float]

    def azimuth_errors(self) -> Values:
        """Return the errors of the azimuth for objects that are not symmetric, one per view."""
        return np.array(self.errors["azimuth"])[np.array(self.turned) >= SYMMETRIC].ravel()


@dataclass(frozen=True)
class EstimateTrials:
    """Measurements of one model.

    strange : kind of image -> its confidences.
    origin : model, digest, training of the heads, machine, date and commit. The file's key is `made`.
    """

    origin: dict[str, Any]
    sources: list[Sightings]
    strange: dict[str, list[float]]

    def write(self, path: Path) -> None:
        """Write as JSON, a source a line, whole or not at all."""
        path.parent.mkdir(parents=True, exist_ok=True)
        rows = ",\n  ".join(json.dumps(asdict(each)) for each in self.sources)
        text = (
            f'{{\n "made": {json.dumps(self.origin)},\n "strange": {json.dumps(self.strange)},\n'
            f' "sources": [\n  {rows}\n ]\n}}\n'
        )
        with whole_file(path) as file:
            file.write(text.encode())

    @classmethod
    def read(cls, path: Path) -> "EstimateTrials":
        """Read a file that `write` wrote."""
        fields = json.loads(path.read_text(encoding="utf-8"))
        return cls(fields["made"], [Sightings(**each) for each in fields["sources"]], fields["strange"])


def measure_estimates(model: Path, data: Path, others: Path | None, split: Split, seed: int) -> EstimateTrials:
    """Measure the estimates of an exported model on a split, and on the sources of `others` that its heads never saw.

    Raises
    ------
    FileNotFoundError : no data set.
    ValueError : the model makes no estimates, or `others` has none of the sources that its card names as kept out.
    """
    encoder = Encoder.open(model, threads=1)
    if not encoder.makes_estimates:
        raise ValueError(f"the model {encoder.name} makes no estimates: run `hof-model heads`")
    training = encoder.card.get("estimates", {})
    objects = list(cases(data, split))
    sightings = [_sightings(encoder, split, objects, has_front=True)]
    for source in training.get("kept_out", []) if others else []:
        matches = [case for case in _all_cases(others) if case.entry.source == source]
        if not matches:
            raise ValueError(f"{others} has no object of {source}, which the heads never saw: build it with them")
        sightings.append(_sightings(encoder, source, matches, has_front=source not in training.get("frontless", [])))
    origin = {"model": encoder.name, "digest": encoder.digest, "training": training, **provenance(seed)}
    return EstimateTrials(origin, sightings, _strange(encoder, objects, seed))


def _all_cases(folder: Path | None) -> list[Case]:
    if folder is None:
        return []
    splits: dict[Split, None] = dict.fromkeys(entry.split for entry in Manifest.read(folder).entries)
    return [case for split in splits for case in cases(folder, split)]


def _sightings(encoder: Encoder, source: str, objects: Sequence[Case], *, has_front: bool) -> Sightings:
    rows = in_threads(lambda case: _sighting(encoder, case), objects, source)
    confidence, scores, azimuths, elevations, turned = (list(column) for column in zip(*rows, strict=True))
    ids = [case.entry.id for case in objects]
    errors = dict(zip(ANGLES, (azimuths, elevations), strict=True))
    return Sightings(source, has_front, ids, confidence, scores, errors, turned)


def _sighting(encoder: Encoder, case: Case) -> tuple[list[float], list[float], list[float], list[float], float]:
    """Return confidences, scores, both angles' errors for the views of an object, and how symmetric it is."""
    confidence, scores, azimuths, elevations = [], [], [], []
    for index in VIEWS:
        encoded = encoder.encode(preprocess(png(case.views[index]), encoder.framing).tensor)[0]
        estimates = encoded.estimates
        if estimates is None:
            raise ValueError(f"the model {encoder.name} makes no estimates")
        azimuth, elevation = case.cameras[index, :2].tolist()
        confidence.append(round(estimates.shape_confidence, 4))
        scores.append(round(compare(draw(encoder.spec, encoded.theta), case.points)[SCORE], 4))
        azimuths.append(round(apart(estimates.camera.azimuth, azimuth), 2))
        elevations.append(round(abs(estimates.camera.elevation - elevation), 2))
    return confidence, scores, azimuths, elevations, round(float(turned_distances(case.points).min()), 4)


def apart(one: float, other: float) -> float:
    """Return the angle between two directions, degrees, 0 to 180."""
    return abs((one - other + 180) % 360 - 180)


def _strange(encoder: Encoder, objects: Sequence[Case], seed: int) -> dict[str, list[float]]:
    """Return the confidences for images of no object, of two objects, and of one that is unlike all known ones."""
    rng, size = np.random.default_rng(seed), 2 * encoder.framing.size
    pictures: dict[str, tuple[Background, list[Bytes]]] = {
        "noise": ("keep", [noise(size, rng) for _ in range(STRANGE_IMAGES)]),
        "a blank photo": (
            "keep",
            [np.full((size, size, 3), level, np.uint8) for level in np.linspace(0, 255, STRANGE_IMAGES).round()],
        ),
        "part of a photograph": (
            "keep",
            [part_of(photographs()[number % 3], size, rng) for number in range(STRANGE_IMAGES)],
        ),
        "two objects": ("auto", [_pair(objects, rng) for _ in range(STRANGE_IMAGES)]),
        MOTORCYCLE: ("auto", list(render_parts(motorcycle(), MOTORCYCLE, seed).views[::2])),
    }
    return {
        kind: [_confidence(encoder, image, background) for image in images]
        for kind, (background, images) in pictures.items()
    }


def _pair(objects: Sequence[Case], rng: np.random.Generator) -> Bytes:
    one, other = (objects[int(index)] for index in rng.choice(len(objects), 2, replace=False))
    return side_by_side(one.views[int(rng.choice(VIEWS))], other.views[int(rng.choice(VIEWS))])


def _confidence(encoder: Encoder, image: Bytes, background: Background) -> float:
    estimates: Estimates | None = encoder.encode(preprocess(png(image), encoder.framing, background).tensor)[
        0
    ].estimates
    return round(estimates.shape_confidence, 4) if estimates else 0.0
