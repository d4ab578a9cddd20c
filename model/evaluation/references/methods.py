"""References that need no training: lower bounds that a trained method must beat, and upper bounds."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image

from model.data.manifest import COLORS, Entry, Manifest
from model.evaluation.evaluate import framed
from model.evaluation.references.features import FRAMING, Features, training_bank
from model.metrics import nearest_distances
from service.encoding.decode import decode
from service.encoding.framing import frame
from service.encoding.masks import MATTING_FLOOR, MattingFunction
from service.encoding.pixels import over_white

Floats = npt.NDArray[np.float32]
Bytes = npt.NDArray[np.uint8]

COARSE_POINTS: Final = 1_000  # per cloud when the oracle compares all training objects
SHORTLIST: Final = 20  # objects that are then compared by all their points


@dataclass(frozen=True)
class Training:
    """The training objects: entries, and their points (objects, 10000, 3)."""

    entries: list[Entry]
    points: Floats

    @classmethod
    def read(cls, data: Path) -> "Training":
        """Read the training objects.

        Raises
        ------
        FileNotFoundError : `data` holds no finished data set.
        """
        entries = list(Manifest.read(data).of("train"))
        return cls(entries, np.stack([points_of(data / entry.file) for entry in entries]))

    def mean_shape(self, n: int, seed: int) -> Floats:
        """Draw n points from all training objects' points together, (n, 3)."""
        index = np.random.default_rng(seed).integers([len(self.points), self.points.shape[1]], size=(n, 2))
        pool: Floats = self.points[index[:, 0], index[:, 1]]
        return pool

    def random_shape(self, id_: str, seed: int) -> Floats:
        """Return the points of a random training object, the same one for the same id and seed."""
        return self._object(int(np.random.default_rng([seed, *id_.encode()]).integers(len(self.points))))

    def oracle(self, true: Floats) -> Floats:
        """Return the points of the training object with the lowest summed cd_epcg to the true points (m, 3).

        All objects are compared by COARSE_POINTS, the best SHORTLIST by all of theirs.
        """
        return nearest_cloud(self.points, self._object, true, ((COARSE_POINTS, SHORTLIST),))

    def _object(self, index: int) -> Floats:
        points: Floats = self.points[index]
        return points


def matched_ellipsoid(true: Floats, seed: int) -> Floats:
    """Draw points on the ellipsoid with the true points' mean and covariance, (m, 3) -> (m, 3).

    An oracle without shape: it knows position, size and orientation of the object, nothing else.
    """
    directions = np.random.default_rng(seed).normal(size=true.shape)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)  # of covariance 1/3
    values, axes = np.linalg.eigh(np.cov(true.T))
    spread = np.sqrt(3 * np.clip(values, 0, None))
    points: Floats = (true.mean(axis=0) + directions * spread @ axes.T).astype(np.float32)
    return points


class Retrieval:
    """Image retrieval: the training object with the view whose features are most similar to the photo's."""

    def __init__(self, data: Path, training: Training, matting: MattingFunction | None = None) -> None:
        self._data = data
        self._features = Features()
        self._bank = training_bank(data, training.entries, self._features)
        self._training = training
        self._matting = matting

    def __call__(self, photo: bytes, n: int) -> Floats:
        """Return n points of the matching object (n, 3) for an image file, its object cut out as the service does."""
        points: Floats = self._training.points[self._match(photo), :n]
        return points

    def surface(self, photo: bytes) -> tuple[Floats, Bytes]:
        """Return all points of the matching object (10000, 3), and their colors (10000, 3) uint8."""
        match = self._match(photo)
        with np.load(self._data / self._training.entries[match].file) as arrays:
            colors: Bytes = arrays[COLORS]
        points: Floats = self._training.points[match]
        return points, colors

    def _match(self, photo: bytes) -> int:
        return self._bank.most_similar(self._features(self._tensor(photo))[0])

    def _tensor(self, photo: bytes) -> Floats:
        """Frame a photo; what a network's mask removes goes whole, as a trace of it costs the features more."""
        whole = framed(photo, FRAMING, self._matting)
        if whole.mask != "matting" or self._matting is None:
            return whole.tensor
        image = decode(photo).convert("RGB")
        matte = self._matting(image)
        image.putalpha(Image.fromarray(np.where(matte > MATTING_FLOOR, matte, 0).astype(np.uint8)))
        return over_white(frame(image, FRAMING).rgba)


def nearest_cloud(
    coarse: Floats, whole: Callable[[int], Floats], true: Floats, rounds: Sequence[tuple[int, int]]
) -> Floats:
    """Return the cloud with the lowest summed cd_epcg to the true points (m, 3), by all points of those that are left.

    Parameters
    ----------
    coarse : (k, p, 3), the first points of each cloud.
    whole : returns all points of the cloud with an index.
    rounds : of each, the points that are compared, and the clouds that are left after it.
    """
    left = np.arange(len(coarse))
    for points, kept in rounds:
        sums = [summed_distance(coarse[index, :points], true[:points]) for index in left]
        left = left[np.argsort(sums)[:kept]]
    clouds = [whole(int(index)) for index in left]
    return clouds[int(np.argmin([summed_distance(cloud, true) for cloud in clouds]))]


def summed_distance(a: Floats, b: Floats) -> float:
    """Return cd_epcg between two clouds (n, 3) and (m, 3), both directions summed, in longest sides."""
    return float(nearest_distances(a, b).mean() + nearest_distances(b, a).mean())


def points_of(file: Path) -> Floats:
    """Return the points of a shape's file, (10000, 3)."""
    with np.load(file) as arrays:
        points: Floats = arrays["points"]
    return points
