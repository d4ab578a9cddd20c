"""Observations of a finished encoder: its inner tensors for images of known objects, and what heads learn of them."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from service.files import whole_file

Floats = npt.NDArray[np.float32]

TURNS_DEG: Final = (45, 90, 135, 180, 225, 270, 315)  # about +Y, by which symmetry is measured
SYMMETRIC: Final = 0.02  # longest sides: an object whose points lie nearer to those of itself turned is symmetric
_INNER: Final = "inner_"


@dataclass(frozen=True)
class Observations:
    """Images of known objects, one row per image.

    inner : name -> (n, ...) float16, the encoder's inner tensors (`model.networks.inner`).
    scores : (n,) float32, F@2% of the encoder's own answer for this image; NaN for objects that it was trained on.
    cameras : (n, 4) float32, azimuth and elevation in degrees, distance in longest sides, roll in degrees; NaN where
        unknown.
    objects : (n,) int64, index into the objects below; -1 for images that show no single object.
    ids, sources : (objects,) of each object.
    turned : (objects, TURNS_DEG) float32, mean distance between the object's points and itself turned, longest sides.
    """

    inner: dict[str, npt.NDArray[np.float16]]
    scores: Floats
    cameras: Floats
    objects: npt.NDArray[np.int64]
    ids: npt.NDArray[np.str_]
    sources: npt.NDArray[np.str_]
    turned: Floats

    def __len__(self) -> int:
        return len(self.scores)

    def symmetric(self) -> npt.NDArray[np.bool_]:
        """Return for each image whether its object is symmetric under each turn, (n, TURNS_DEG)."""
        none = np.ones((1, len(TURNS_DEG)), np.float32)  # for index -1
        return np.concatenate([self.turned, none])[self.objects] < SYMMETRIC

    def write(self, path: Path) -> None:
        """Write as .npz, whole or not at all."""
        arrays = {name: value for name, value in vars(self).items() if name != "inner"}
        arrays |= {_INNER + name: array for name, array in self.inner.items()}
        path.parent.mkdir(parents=True, exist_ok=True)
        with whole_file(path) as file:
            np.savez(file, **arrays)

    @classmethod
    def read(cls, path: Path) -> "Observations":
        """Read a file that `write` wrote.

        Raises
        ------
        ValueError : the file holds no observations.
        """
        try:
            with np.load(path) as arrays:
                inner = {name.removeprefix(_INNER): arrays[name] for name in arrays if name.startswith(_INNER)}
                return cls(inner, **{name: arrays[name] for name in arrays if not name.startswith(_INNER)})
        except TypeError as error:
            raise ValueError(f"{path} holds no observations: remove it, or name another file") from error
