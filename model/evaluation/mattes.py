"""Measure mattes on objects in front of photographs that no training saw: the masks, and the objects behind them."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from model.data.manifest import Split
from model.evaluation.conditions import photograph, png
from model.evaluation.evaluate import Case, cases, chosen_views, draw, framed, in_threads
from model.metrics import compare
from model.provenance import provenance
from service.encoding.encoder import Encoder
from service.encoding.masks import MATTING_FLOOR, Matte, MattingFunction
from service.files import whole_file

Bytes = npt.NDArray[np.uint8]

ZOOMS: Final = (0.9, 0.45)  # shares of the picture's side that the object's longer side takes
SIDE: Final = 384  # pixels of a picture
WHOLE_PICTURE: Final = "the whole picture"
TRUE_MASKS: Final = "true masks"
U2NET: Final = "U2-Net, small"
SCORES: Final = ("f@1%", "f@2%")


@dataclass(frozen=True)
class Outcome:
    """A way to find the object, at one zoom: a value for each picture.

    overlaps : intersection over union of the mask with the true one; empty for a way without masks.
    scores : metric -> values of the object behind that mask.
    refused : pictures in which the service would find no object; they count with the whole picture.
    """

    way: str
    zoom: float
    overlaps: list[float]
    scores: dict[str, list[float]]
    refused: int


@dataclass(frozen=True)
class MatteTrials:
    """The outcomes of all ways, and where they come from."""

    origin: dict[str, Any]
    outcomes: list[Outcome]

    def write(self, path: Path) -> None:
        """Write as JSON, whole or not at all."""
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as file:
            lines = ",\n  ".join(json.dumps(asdict(each)) for each in self.outcomes)
            file.write(f'{{\n "origin": {json.dumps(self.origin)},\n "outcomes": [\n  {lines}\n ]\n}}\n'.encode())

    @classmethod
    def read(cls, path: Path) -> "MatteTrials":
        """Read a file that `write` wrote."""
        fields = json.loads(path.read_text(encoding="utf-8"))
        return cls(fields["origin"], [Outcome(**each) for each in fields["outcomes"]])


def measure_mattes(
    encoder: Encoder, ways: Mapping[str, MattingFunction], data: Path, split: Split, seed: int
) -> MatteTrials:
    """Measure ways to find the object, and the two bounds: WHOLE_PICTURE and TRUE_MASKS.

    Raises
    ------
    FileNotFoundError : `data` holds no finished data set.
    """
    objects, outcomes = list(cases(data, split)), []
    for zoom in ZOOMS:
        for way, matting in {WHOLE_PICTURE: None, **ways, TRUE_MASKS: None}.items():
            trials = _trials(encoder, way, matting, zoom, seed)
            rows = [row for rows in in_threads(trials, objects, f"{way}, {zoom}") for row in rows]
            scores = {name: [round(row[0][name], 4) for row in rows] for name in SCORES}
            overlaps = [round(row[1], 4) for row in rows if row[1] is not None]
            outcomes.append(Outcome(way, zoom, overlaps, scores, sum(row[2] for row in rows)))
    origin = {"model": encoder.name, "split": split, "objects": len(objects), **provenance(seed)}
    return MatteTrials(origin, outcomes)


Row = tuple[dict[str, float], float | None, bool]


def _trials(
    encoder: Encoder, way: str, matting: MattingFunction | None, zoom: float, seed: int
) -> Callable[[Case], list[Row]]:
    """Return the function that tries a way on all views of an object."""

    def trials(case: Case) -> list[Row]:
        rng = np.random.default_rng([seed, round(100 * zoom), *case.entry.id.encode()])
        return [trial(case, *picture_of(view, zoom, rng)) for view in chosen_views(case.views)]

    def trial(case: Case, picture: Bytes, mask: Bytes) -> Row:
        overlap = None
        if way == TRUE_MASKS:
            picture = np.dstack([picture, mask])
        elif matting:
            overlap = overlap_of(matting(Image.fromarray(picture)), mask)
        taken = framed(png(picture), encoder.framing, matting)
        theta = encoder.encode_photo(taken).theta
        return compare(draw(encoder.spec, theta), case.points), overlap, bool(matting) and taken.mask == "none"

    return trials


def picture_of(view: Bytes, zoom: float, rng: np.random.Generator) -> tuple[Bytes, Bytes]:
    """Put a view (S, S, 4) uint8 somewhere on a photograph: the picture (SIDE, SIDE, 3) and its matte (SIDE, SIDE).

    The object's longer side takes `zoom` of the picture's.
    """
    ground = Image.fromarray(photograph((SIDE, SIDE), rng))
    cut = Image.fromarray(view)
    cut = cut.crop(cut.getchannel("A").getbbox())
    factor = zoom * SIDE / max(cut.size)
    cut = cut.resize((max(1, round(cut.width * factor)), max(1, round(cut.height * factor))), Image.Resampling.BILINEAR)
    place = (int(rng.integers(SIDE - cut.width + 1)), int(rng.integers(SIDE - cut.height + 1)))
    matte = Image.new("L", ground.size)
    matte.paste(cut.getchannel("A"), place)
    ground.paste(cut, place, cut)
    return np.asarray(ground), np.asarray(matte)


def overlap_of(one: Matte, other: Matte) -> float:
    """Return the intersection over union of two mattes (H, W) above MATTING_FLOOR; that of two empty ones is 1."""
    a, b = one > MATTING_FLOOR, other > MATTING_FLOOR
    return float(((a & b).sum() + 1) / ((a | b).sum() + 1))
