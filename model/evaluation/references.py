"""Answers that need no training: what any trained method has to be better than, and the best one could hope for."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from model.data.manifest import Entry, Manifest
from model.evaluation.features import FRAMING, Features, training_bank
from model.metrics import nearest
from service.encoding.framing import preprocess

Floats = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]

COARSE: Final = 1_000  # points per cloud when the oracle looks at all training objects
SHORTLIST: Final = 20  # of them are then compared by all their points


@dataclass(frozen=True)
class Training:
    """The training objects: entries, and their points (objects, 10000, 3)."""

    entries: list[Entry]
    points: Floats

    @classmethod
    def read(cls, data: Path) -> "Training":
        """Raises FileNotFoundError without a finished data set."""
        entries = list(Manifest.read(data).of("train"))
        return cls(entries, np.stack([_points(data, entry) for entry in entries]))

    def mean_shape(self, n: int, seed: int) -> Floats:
        """n points drawn from all training objects' points together."""
        drawn = np.random.default_rng(seed).integers([len(self.points), self.points.shape[1]], size=(n, 2))
        pool: Floats = self.points[drawn[:, 0], drawn[:, 1]]
        return pool

    def random_shape(self, id_: str, seed: int) -> Floats:
        """The points of some training object, the same one for the same id and seed."""
        return self._object(int(np.random.default_rng([seed, *id_.encode()]).integers(len(self.points))))

    def oracle(self, true: Floats) -> Floats:
        """The training object with the lowest summed cd_epcg to the true points (m, 3): its points.

        All are compared by COARSE points, the best SHORTLIST by all of theirs.
        """
        coarse = true[:COARSE]
        sums = [_summed(points[:COARSE], coarse) for points in self.points]
        best = np.argsort(sums)[:SHORTLIST]
        exact = [_summed(self.points[index], true) for index in best]
        return self._object(int(best[int(np.argmin(exact))]))

    def _object(self, index: int) -> Floats:
        points: Floats = self.points[index]
        return points


def blob(true: Floats, seed: int) -> Floats:
    """The ellipsoid with the true points' mean and covariance: as many points, spread as over a sphere that is
    stretched, (m, 3) -> (m, 3). What has no more shape than a place, a size and a slant."""
    directions = np.random.default_rng(seed).normal(size=true.shape)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)  # of covariance 1/3
    values, axes = np.linalg.eigh(np.cov(true.T))
    spread = np.sqrt(3 * np.clip(values, 0, None))
    points: Floats = (true.mean(axis=0) + directions * spread @ axes.T).astype(np.float32)
    return points


class Retrieval:
    """The training object whose image, of any of its views, has the features most like the photo's."""

    def __init__(self, data: Path, training: Training) -> None:
        self._data = data
        self._features = Features()
        self._bank = training_bank(data, training.entries, self._features)
        self._training = training

    def __call__(self, photo: bytes, n: int) -> Floats:
        """An image file's bytes, framed as the service frames them -> n of the found object's points (n, 3)."""
        points: Floats = self._training.points[self._find(photo), :n]
        return points

    def surface(self, photo: bytes) -> tuple[Floats, Bytes]:
        """All of the found object's points (10000, 3), and their colours (10000, 3) uint8."""
        found = self._find(photo)
        with np.load(self._data / self._training.entries[found].file) as arrays:
            colours: Bytes = arrays["colours"]
        points: Floats = self._training.points[found]
        return points, colours

    def _find(self, photo: bytes) -> int:
        return self._bank.nearest(self._features(preprocess(photo, FRAMING).tensor)[0])


def _summed(a: Floats, b: Floats) -> float:
    return float(nearest(a, b).mean() + nearest(b, a).mean())


def _points(data: Path, entry: Entry) -> Floats:
    with np.load(data / entry.file) as arrays:
        points: Floats = arrays["points"]
    return points
