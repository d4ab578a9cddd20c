"""All shapes that a training split gives: its objects, their stretched and warped copies, and the pieces."""

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from model.data.manifest import PIECES, Manifest, piece_files, variant_file, variant_files
from model.evaluation.references.methods import COARSE_POINTS, SHORTLIST, nearest_cloud, points_of

Floats = npt.NDArray[np.float32]

FIRST_POINTS: Final = 250  # per cloud when all shapes are compared
FIRST_SHORTLIST: Final = 200  # shapes that are then compared by COARSE_POINTS, as the oracle compares objects


@dataclass(frozen=True)
class TrainingShapes:
    """The files of all shapes, and the first of their points, (shapes, COARSE_POINTS, 3)."""

    files: list[Path]
    coarse: Floats

    @classmethod
    def read(cls, data: Path) -> "TrainingShapes":
        """Read the shapes of a data set; copies and pieces if there are any.

        Raises
        ------
        FileNotFoundError : `data` holds no finished data set.
        """
        files = []
        for entry in Manifest.read(data).of("train"):
            has_variants = variant_file(data, entry, 0).exists()  # the object itself; copies follow
            files += [data / entry.file, *(variant_files(data, entry)[1:] if has_variants else [])]
        if (data / PIECES).is_dir():
            files += piece_files(data)
        return cls(files, np.stack([points_of(file)[:COARSE_POINTS] for file in files]))

    def oracle(self, true: Floats) -> Floats:
        """Return the points of the shape with the lowest summed cd_epcg to the true points (m, 3).

        Fewer and fewer shapes are compared, by more and more of their points.
        """
        rounds = ((FIRST_POINTS, FIRST_SHORTLIST), (COARSE_POINTS, SHORTLIST))
        return nearest_cloud(self.coarse, lambda index: points_of(self.files[index]), true, rounds)
