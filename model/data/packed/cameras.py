"""The cameras of a packed data set's views, beside its shards: azimuth and elevation in degrees."""

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from service.files import whole_file

CAMERAS: Final = "cameras.npz"

Floats = npt.NDArray[np.float32]


def write_cameras(output: Path, files: Mapping[str, Path]) -> Path:
    """Write the cameras of all views of shapes, by the rows' keys; shapes whose file has none are left out."""
    keys, cameras = [], []
    for key, path in files.items():
        with np.load(path) as arrays:
            if "cameras" in arrays:
                keys.append(key)
                cameras.append(arrays["cameras"][:, :2].astype(np.float32))
    path = output / CAMERAS
    with whole_file(path) as file:
        np.savez_compressed(
            file,
            keys=np.array(keys, np.str_),
            counts=np.array([len(each) for each in cameras], np.int64),
            cameras=np.concatenate([*cameras, np.empty((0, 2), np.float32)]),
        )
    return path


def read_cameras(folder: Path) -> dict[str, Floats]:
    """Return the cameras of each shape's views, (views, 2), by its key.

    Raises
    ------
    FileNotFoundError : the data set was packed without them.
    """
    path = folder / CAMERAS
    if not path.is_file():
        raise FileNotFoundError(f"{path} is missing: run the same `hof-model data pack` again, which adds it")
    with np.load(path) as arrays:
        ends = np.cumsum(arrays["counts"])
        parts = np.split(arrays["cameras"], ends[:-1])
        return dict(zip(arrays["keys"].tolist(), parts, strict=True))
