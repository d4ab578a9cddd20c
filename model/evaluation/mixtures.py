"""Mixtures of two objects: words of their functions against the mean of their thetas (paper, Object Interpolation).

Measures the distance of a mixture to the nearest training shape and to its parents. Distances are cd_epcg, both
directions summed, x100.
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
from model.evaluation.evaluate import VIEWS, Case, cases, encode_photo
from model.evaluation.references.methods import Training, summed_distance
from model.evaluation.references.neighbors import Neighbors
from model.provenance import provenance
from service.drawing.words import rows_of_words, sheet
from service.encoding.encoder import Encoder
from service.files import whole_file
from service.mapping.sampler import Sampler
from service.mapping.spec import MappingSpec

Floats = npt.NDArray[np.float32]
Values = npt.NDArray[np.float64]
Pair = tuple[int, int, bool]  # indices of A and B, and whether they share a class

PAIRS: Final = 200
CLOUD_POINTS: Final = 2_000  # of each cloud
AVERAGE: Final = "average"
FIGURES: Final = ("nearest", "to_a", "to_b")
COPY: Final = 1.5  # a copy is at most this many times as far from a parent as another sample of that parent
SHOWN: Final = 3  # pairs of each kind in the picture
CELL: Final = 180  # pixels of a cell of the picture
DIGITS: Final = 4


@dataclass(frozen=True)
class Mixtures:
    """Measurements of one model's mixtures.

    origin : where the figures come from: model, seed, commit, machine, date.
    pairs : ids of A and B, and whether they share a class.
    figures : of the objects A and B, of each word and of AVERAGE: one value a pair of `nearest`, the distance to the
        nearest training object, and of `to_a` and `to_b`, those to other samples of the objects A and B.
    """

    model: str
    k: int
    split: str
    origin: dict[str, Any]
    pairs: tuple[tuple[str, str, bool], ...]
    figures: dict[str, dict[str, Values]]

    @property
    def in_class(self) -> npt.NDArray[np.bool_]:
        """Mask of the pairs that share a class, (pairs,)."""
        return np.array([same for *_, same in self.pairs])

    def words(self, figure: str) -> Values:
        """Return the figure's mean over the words of as many A as B, (pairs,)."""
        mean: Values = np.mean([self.figures[word][figure] for word in even_words(self.k)], axis=0)
        return mean

    def parents(self, figure: str) -> Values:
        """Return the figure's mean over A and B, (pairs,)."""
        mean: Values = np.mean([self.figures[name][figure] for name in "AB"], axis=0)
        return mean

    def copies(self, name: str) -> npt.NDArray[np.bool_]:
        """Return a mask of the mixtures that nearly equal a parent, (pairs,)."""
        mixture, a, b = (self.figures[each] for each in (name, "A", "B"))
        close: npt.NDArray[np.bool_] = (mixture["to_a"] <= COPY * a["to_a"]) | (mixture["to_b"] <= COPY * b["to_b"])
        return close

    def write(self, path: Path) -> None:
        """Write as JSON, numbers rounded to DIGITS, whole or not at all."""
        fields = {"made" if name == "origin" else name: value for name, value in asdict(self).items()}
        for columns in fields["figures"].values():
            columns.update({name: np.round(values, DIGITS).tolist() for name, values in columns.items()})
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as file:
            file.write((json.dumps(fields, ensure_ascii=False) + "\n").encode())

    @classmethod
    def read(cls, path: Path) -> "Mixtures":
        """Read a file that `write` wrote.

        Raises
        ------
        ValueError : the file holds something else.
        """
        try:
            fields = json.loads(path.read_text(encoding="utf-8"))
            fields["pairs"] = tuple((a, b, same) for a, b, same in fields["pairs"])
            fields["figures"] = {
                name: {figure: np.array(columns[figure]) for figure in FIGURES}
                for name, columns in fields["figures"].items()
            }
            return cls(origin=fields.pop("made"), **fields)
        except (KeyError, TypeError, AttributeError, json.JSONDecodeError) as error:
            raise ValueError(f"{path} holds no mixtures; write it with `hof-model mixtures`") from error


def even_words(k: int) -> list[str]:
    """Return the words of two equal blocks of A and B, or nearly equal ones: AB and BA; AABB and BBAA."""
    return [first * (k // 2) + last * (k - k // 2) for first, last in ("AB", "BA")]


def mixed_words(k: int) -> list[str]:
    """Return the words that are measured: the even ones, and the paper's gradient between A and B."""
    gradient = ["A" * (k - count) + "B" * count for count in range(1, k)]
    return list(dict.fromkeys([*gradient, *even_words(k)]))


def draw_pairs(entries: Sequence[Entry], seed: int) -> list[Pair]:
    """Draw PAIRS different pairs of objects: half within a class, or as many as exist, the rest across classes.

    Objects of class OTHER are paired only with objects of another class.
    """
    labels = [class_of(entry) for entry in entries]
    rng = np.random.default_rng(seed)
    every = [(a, b) for a in range(len(labels)) for b in range(a)]
    order = [every[index] if rng.random() < 0.5 else every[index][::-1] for index in rng.permutation(len(every))]
    same = [(a, b, True) for a, b in order if labels[a] == labels[b] != OTHER][: PAIRS // 2]
    across = [(a, b, False) for a, b in order if labels[a] != labels[b]]
    return same + across[: PAIRS - len(same)]


def measure(encoder: Encoder, data: Path, split: Split, seed: int = 0) -> tuple[Mixtures, Image.Image]:
    """Measure mixtures of a split's objects, and draw a picture of the first pairs of each kind.

    Raises
    ------
    FileNotFoundError : no data set.
    ValueError : k is 1, so the model composes nothing, or the split has fewer than two objects.
    """
    spec, objects = encoder.spec, list(cases(data, split))
    if spec.k < 2 or len(objects) < 2:
        raise ValueError(
            f"mixtures need k of 2 or more and two objects: {encoder.name} has k = {spec.k}, "
            f"the {split} split {len(objects)} objects"
        )
    thetas = [_theta(encoder, case) for case in objects]
    pairs = draw_pairs([case.entry for case in objects], seed)
    training = Neighbors(Training.read(data).points[:, :CLOUD_POINTS])
    ids = [case.entry.id for case in objects]
    mixtures = Mixtures(
        encoder.name,
        spec.k,
        split,
        {"digest": encoder.digest, **provenance(seed)},
        tuple((ids[a], ids[b], same) for a, b, same in pairs),
        _figures(spec, thetas, pairs, training),
    )
    return mixtures, _picture(spec, thetas, ids, pairs)


def _figures(
    spec: MappingSpec, thetas: Sequence[Floats], pairs: Sequence[Pair], training: Neighbors
) -> dict[str, dict[str, Values]]:
    """Return FIGURES of A, of B and of every mixture, pair by pair."""
    mixtures = [*mixed_words(spec.k), AVERAGE]
    objects = {index: _draw(spec, thetas[index]) for a, b, _ in pairs for index in (a, b)}
    progress = tqdm(objects.items(), desc="objects", unit="object", disable=None)
    object_distances = {index: training.distance(cloud) for index, cloud in progress}
    rows = []
    for a, b, _ in tqdm(pairs, desc="mixtures", unit="pair", disable=None):
        parents = [_draw(spec, thetas[index], seed=1) for index in (a, b)]
        clouds = [_draw(spec, thetas[a], thetas[b], name) for name in mixtures]
        distances = [object_distances[a], object_distances[b], *(training.distance(cloud) for cloud in clouds)]
        rows.append(
            [
                (distance, *(summed_distance(cloud, parent) for parent in parents))
                for distance, cloud in zip(distances, [objects[a], objects[b], *clouds], strict=True)
            ]
        )
    values = 100 * np.array(rows)  # (pairs, names, figures)
    return {
        name: {figure: values[:, row, column] for column, figure in enumerate(FIGURES)}
        for row, name in enumerate(["A", "B", *mixtures])
    }


def _theta(encoder: Encoder, case: Case) -> Floats:
    """Encode the first evaluated view of an object as the service would."""
    return encode_photo(encoder, png(case.views[VIEWS[0]])).theta


def _draw(
    spec: MappingSpec, a: Floats, b: Floats | None = None, name: str = AVERAGE, n: int = CLOUD_POINTS, seed: int = 0
) -> Floats:
    """Draw n points of a word over A and B, or of the mean of their thetas; of A alone if `b` is None."""
    if b is None or name == AVERAGE:
        word = [a if b is None else (a + b) / np.float32(2)] * spec.k
    else:
        word = [a if letter == "A" else b for letter in name]
    return Sampler(spec.with_k(len(word)), word).points(n, seed=seed)


def _picture(spec: MappingSpec, thetas: Sequence[Floats], ids: Sequence[str], pairs: Sequence[Pair]) -> Image.Image:
    """Draw the first pairs of each kind, a row each: the words, then the average."""
    words = [*(word for row in rows_of_words(spec.k) for word in row), AVERAGE]
    rows = []
    for kind in (True, False):
        for a, b, _ in [pair for pair in pairs if pair[2] is kind][:SHOWN]:
            labels = {"A" * spec.k: ids[a].rpartition("/")[2], "B" * spec.k: ids[b].rpartition("/")[2]}
            rows.append(
                [
                    (labels.get(word, word), _draw(spec, thetas[a], thetas[b], word, 2 * CLOUD_POINTS), None)
                    for word in words
                ]
            )
    return sheet(rows, cell=CELL)
