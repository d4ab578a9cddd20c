"""Mixtures of two objects: words of their functions against the mean of their thetas (paper, Object Interpolation).

How far is a mixture from any real shape, and from its parents? Distances are cd_epcg, both directions summed, x100.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from PIL import Image
from tqdm import tqdm

from model.data.manifest import Entry, Split
from model.evaluation.classes import OTHER, class_of
from model.evaluation.conditions import png
from model.evaluation.evaluate import VIEWS, Case, cases, encoded
from model.evaluation.neighbours import Neighbours
from model.evaluation.references import Training
from model.metrics import nearest
from model.provenance import provenance
from service.drawing.words import rows_of_words, sheet
from service.encoding.encoder import Encoder
from service.files import whole_file
from service.mapping.sampler import Sampler
from service.mapping.spec import MappingSpec

Floats = npt.NDArray[np.float32]
Values = npt.NDArray[np.float64]
Pair = tuple[int, int, bool]  # numbers of A and B, whether they are of one class

PAIRS: Final = 200
POINTS: Final = 2_000  # of each cloud
AVERAGE: Final = "average"
FIGURES: Final = ("nearest", "to_a", "to_b")
COPY: Final = 1.5  # so many times as far from a parent as another sample of that parent, or less: a copy of it
SHOWN: Final = 3  # pairs of each kind in the picture
CELL: Final = 180  # pixels of a cell of the picture
DIGITS: Final = 4


@dataclass(frozen=True)
class Mixtures:
    """What one model's mixtures measure.

    pairs : ids of A and B, and whether they are of one class.
    figures : of the objects A and B, of each word and of AVERAGE: one value a pair of `nearest`, the distance to the
        nearest training object, and of `to_a` and `to_b`, those to other samples of the objects A and B.
    """

    model: str
    k: int
    split: str
    made: dict[str, Any]
    pairs: tuple[tuple[str, str, bool], ...]
    figures: dict[str, dict[str, Values]]

    @property
    def in_class(self) -> npt.NDArray[np.bool_]:
        """Which pairs are of one class, (pairs,)."""
        return np.array([same for *_, same in self.pairs])

    def words(self, figure: str) -> Values:
        """The figure's mean over the words of as many A as B, (pairs,)."""
        mean: Values = np.mean([self.figures[word][figure] for word in even_words(self.k)], axis=0)
        return mean

    def parents(self, figure: str) -> Values:
        """The figure's mean over A and B, (pairs,)."""
        mean: Values = np.mean([self.figures[name][figure] for name in "AB"], axis=0)
        return mean

    def copies(self, name: str) -> npt.NDArray[np.bool_]:
        """Which mixtures are all but one of their parents, (pairs,)."""
        found, a, b = (self.figures[each] for each in (name, "A", "B"))
        close: npt.NDArray[np.bool_] = (found["to_a"] <= COPY * a["to_a"]) | (found["to_b"] <= COPY * b["to_b"])
        return close

    def write(self, path: Path) -> None:
        """Write as JSON, numbers rounded to DIGITS, whole or not at all."""
        fields = asdict(self)
        for columns in fields["figures"].values():
            columns.update({name: np.round(values, DIGITS).tolist() for name, values in columns.items()})
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as file:
            file.write((json.dumps(fields, ensure_ascii=False) + "\n").encode())

    @classmethod
    def read(cls, path: Path) -> "Mixtures":
        """Inverse of `write`. Raises ValueError for another file."""
        try:
            fields = json.loads(path.read_text(encoding="utf-8"))
            fields["pairs"] = tuple((a, b, same) for a, b, same in fields["pairs"])
            fields["figures"] = {
                name: {figure: np.array(columns[figure]) for figure in FIGURES}
                for name, columns in fields["figures"].items()
            }
            return cls(**fields)
        except (KeyError, TypeError, AttributeError, json.JSONDecodeError) as error:
            raise ValueError(f"{path} holds no mixtures; write it with `hof-model mixtures`") from error


def even_words(k: int) -> list[str]:
    """The words of as many A as B in two blocks, or nearly: AB and BA; AABB and BBAA."""
    return [first * (k // 2) + last * (k - k // 2) for first, last in ("AB", "BA")]


def mixed_words(k: int) -> list[str]:
    """The words that are measured: the even ones, and what the paper's gradient has between A and B."""
    gradient = ["A" * (k - count) + "B" * count for count in range(1, k)]
    return list(dict.fromkeys([*gradient, *even_words(k)]))


def draw_pairs(entries: Sequence[Entry], seed: int) -> list[Pair]:
    """PAIRS random pairs of objects, no two alike: half of one class, or as many as there are, and half of two.

    Objects of no known class are only paired with such of a known one.
    """
    labels = [class_of(entry) for entry in entries]
    rng = np.random.default_rng(seed)
    every = [(a, b) for a in range(len(labels)) for b in range(a)]
    order = [every[index] if rng.random() < 0.5 else every[index][::-1] for index in rng.permutation(len(every))]
    same = [(a, b, True) for a, b in order if labels[a] == labels[b] != OTHER][: PAIRS // 2]
    across = [(a, b, False) for a, b in order if labels[a] != labels[b]]
    return same + across[: PAIRS - len(same)]


def measure(encoder: Encoder, data: Path, split: Split, seed: int = 0) -> tuple[Mixtures, Image.Image]:
    """The mixtures of a split's objects, and a picture of the first pairs of each kind.

    Raises
    ------
    FileNotFoundError : no data set.
    ValueError : the model composes nothing, k is 1, or the split has fewer than two objects.
    """
    spec, objects = encoder.spec, list(cases(data, split))
    if spec.k < 2 or len(objects) < 2:
        raise ValueError(f"mixtures need k of 2 or more and two objects, not k = {spec.k} and {len(objects)} objects")
    thetas = [_theta(encoder, case) for case in objects]
    pairs = draw_pairs([case.entry for case in objects], seed)
    training = Neighbours(Training.read(data).points[:, :POINTS])
    ids = [case.entry.id for case in objects]
    found = Mixtures(
        encoder.name,
        spec.k,
        split,
        {"digest": encoder.digest, **provenance(seed)},
        tuple((ids[a], ids[b], same) for a, b, same in pairs),
        _figures(spec, thetas, pairs, training),
    )
    return found, _picture(spec, thetas, ids, pairs)


def _figures(
    spec: MappingSpec, thetas: Sequence[Floats], pairs: Sequence[Pair], training: Neighbours
) -> dict[str, dict[str, Values]]:
    """FIGURES of A, of B and of every mixture, pair by pair."""
    mixtures = [*mixed_words(spec.k), AVERAGE]
    objects = {index: _draw(spec, thetas[index]) for a, b, _ in pairs for index in (a, b)}
    known = {index: training.distance(cloud) for index, cloud in tqdm(objects.items(), desc="objects", unit="object")}
    rows = []
    for a, b, _ in tqdm(pairs, desc="mixtures", unit="pair"):
        parents = [_draw(spec, thetas[index], seed=1) for index in (a, b)]
        clouds = [_draw(spec, thetas[a], thetas[b], name) for name in mixtures]
        distances = [known[a], known[b], *(training.distance(cloud) for cloud in clouds)]
        rows.append(
            [
                (distance, *(_summed(cloud, parent) for parent in parents))
                for distance, cloud in zip(distances, [objects[a], objects[b], *clouds], strict=True)
            ]
        )
    values = 100 * np.array(rows)  # (pairs, names, figures)
    return {
        name: {figure: values[:, row, column] for column, figure in enumerate(FIGURES)}
        for row, name in enumerate(["A", "B", *mixtures])
    }


def _theta(encoder: Encoder, case: Case) -> Floats:
    """theta of an object's first view that is evaluated, as the service would encode it."""
    return encoded(encoder, png(case.views[VIEWS[0]])).theta


def _draw(
    spec: MappingSpec, a: Floats, b: Floats | None = None, name: str = AVERAGE, n: int = POINTS, seed: int = 0
) -> Floats:
    """n points of a word over A and B of any length, or of the mean of their thetas; of A alone without B."""
    if b is None or name == AVERAGE:
        word = [a if b is None else (a + b) / np.float32(2)] * spec.k
    else:
        word = [a if letter == "A" else b for letter in name]
    return Sampler(spec.with_k(len(word)), word).points(n, seed=seed)


def _summed(a: Floats, b: Floats) -> float:
    return float(nearest(a, b).mean() + nearest(b, a).mean())


def _picture(spec: MappingSpec, thetas: Sequence[Floats], ids: Sequence[str], pairs: Sequence[Pair]) -> Image.Image:
    """The first pairs of each kind, a row each: the words of a sheet, then the average."""
    words = [*(word for row in rows_of_words(spec.k) for word in row), AVERAGE]
    rows = []
    for kind in (True, False):
        for a, b, _ in [pair for pair in pairs if pair[2] is kind][:SHOWN]:
            labels = {"A" * spec.k: ids[a].rpartition("/")[2], "B" * spec.k: ids[b].rpartition("/")[2]}
            rows.append(
                [(labels.get(word, word), _draw(spec, thetas[a], thetas[b], word, 2 * POINTS)) for word in words]
            )
    return sheet(rows, cell=CELL)
