"""Points of a model from the files of ShapeNet's layouts: MATLAB, binvox, PLY. The frame and scale are the file's."""

import io
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

VOXEL_POINTS: Final = 20_000  # drawn on the surface of voxels
OCCUPIED: Final = 0.5  # voxels above it are the object

Floats = npt.NDArray[np.float32]
Grid = npt.NDArray[np.bool_]


def read_cloud(path: Path) -> Floats:
    """Return a file's points, (n, 3).

    Raises
    ------
    ValueError : the file is none of the known ones, or holds no point.
    """
    readers = {".mat": _read_mat, ".binvox": _read_binvox, ".ply": _read_ply}
    if path.suffix not in readers:
        raise ValueError(f"{path} is no file of points: {', '.join(readers)} are read")
    try:
        points = readers[path.suffix](path)
    except (KeyError, IndexError, TypeError, NotImplementedError, EOFError, UnicodeDecodeError) as error:
        raise ValueError(f"{path} cannot be read: {error!r}") from error
    if not len(points) or not np.isfinite(points).all():
        raise ValueError(f"{path} holds no points, or some that are not finite")
    return np.ascontiguousarray(points, np.float32)


def _read_mat(path: Path) -> Floats:
    """Read EPCG's cloud, the vertices V and the points Vd added on edges, or the voxels of nips16_PTN."""
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        arrays = loadmat(path)
    except MatReadError as error:
        raise ValueError(f"{path} is no MATLAB file of version 4 to 7: {error}") from error
    if "voxel" in arrays:
        grid = np.squeeze(arrays["voxel"]) > OCCUPIED
        return surface_of(grid) - np.float32(0.5)
    points: Floats = np.concatenate([arrays["V"], arrays["Vd"]]).astype(np.float32)
    return points


def _read_binvox(path: Path) -> Floats:
    """Read a binvox file: a text header, then runs of equal voxels, y fastest, then z, then x."""
    data = io.BytesIO(path.read_bytes())
    if not data.readline().startswith(b"#binvox"):
        raise ValueError(f"{path} is no binvox file")
    header: dict[str, list[str]] = {}
    while (words := data.readline().decode("ascii").split()) and words[0] != "data":
        header[words[0]] = words[1:]
    sides = [int(side) for side in header["dim"]]
    runs = np.frombuffer(data.read(), np.uint8).reshape(-1, 2)
    values = np.repeat(runs[:, 0], runs[:, 1])
    if len(values) != np.prod(sides):
        raise ValueError(f"{path} holds {len(values)} voxels, its header says {' x '.join(map(str, sides))}")
    grid = values.reshape(sides).transpose(0, 2, 1) > 0  # x, z, y -> x, y, z
    translate = np.array([float(each) for each in header["translate"]], np.float32)
    return surface_of(grid) * np.float32(header["scale"][0]) + translate


def _read_ply(path: Path) -> Floats:
    import trimesh

    loaded = trimesh.load(path, process=False)
    points: Floats = np.asarray(getattr(loaded, "vertices", np.empty((0, 3))), np.float32)
    return points


def surface_of(grid: Grid) -> Floats:
    """Draw VOXEL_POINTS points uniformly on the outer faces of voxels (x, y, z), (n, 3) in units of the grid's side.

    Raises
    ------
    ValueError : the grid is no cube, or empty.
    """
    if grid.ndim != 3 or len(set(grid.shape)) > 1 or not grid.any():
        raise ValueError(f"an occupied cube of voxels is expected, the shape is {grid.shape}")
    side = len(grid)
    padded = np.pad(grid, 1)
    faces = []
    for axis in range(3):
        for step in (-1, 1):
            outer = grid & ~np.roll(padded, -step, axis)[1:-1, 1:-1, 1:-1]
            corners = np.argwhere(outer).astype(np.float32)
            faces.append((corners, axis, step))
    counts = np.array([len(corners) for corners, _, _ in faces])
    rng = np.random.default_rng(0)
    drawn = rng.multinomial(VOXEL_POINTS, counts / counts.sum())
    points = []
    for (corners, axis, step), count in zip(faces, drawn.tolist(), strict=True):
        inside = rng.random((count, 3), np.float32)
        inside[:, axis] = (step + 1) / 2
        points.append(corners[rng.integers(max(1, len(corners)), size=count)] + inside)
    whole: Floats = (rng.permutation(np.concatenate(points)) / side).astype(np.float32)
    return whole
