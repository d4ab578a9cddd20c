"""A file of points, or of a mesh, becomes points. The content decides the format, not the name.

Faults raise CorruptPoints; more than MAX_POINTS points or MAX_TRIANGLES triangles raise TooLarge.
"""

from collections.abc import Callable
from io import BytesIO
from typing import Final, Literal

import numpy as np
from numpy.lib import format as npy_format

from service.errors import CorruptPoints, TooLarge, UnsupportedMedia
from service.formats.scans import glb, pcd, ply, text
from service.formats.scans.limits import MAX_POINTS, MAX_TRIANGLES, Doubles

Kind = Literal["ply", "pcd", "npy", "xyz", "glb", "obj", "stl"]

SAMPLES: Final = 20_000  # points of a mesh: ten times what an encoder takes
SEED: Final = 0
NPY_MAGIC: Final = b"\x93NUMPY"
STL_HEAD: Final = 84
STL_TRIANGLE: Final = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
NAMES: Final = "PLY, PCD, NPY or XYZ points, or a GLB, OBJ or STL mesh"


def kind_of(data: bytes) -> Kind | None:
    """Return the format of a file by its content; None if it is none of these."""
    magics: dict[bytes, Kind] = {b"ply\n": "ply", b"ply\r": "ply", NPY_MAGIC: "npy", b"glTF": "glb"}
    for magic, kind in magics.items():
        if data.startswith(magic):
            return kind
    return "stl" if _is_binary_stl(data) else text.kind_of(data)


def read_points(data: bytes) -> Doubles:
    """Return the points of a file, (n, 3) float64; those of a mesh are sampled from its surface.

    Raises
    ------
    UnsupportedMedia : none of the formats, or a variant of one that is not read.
    CorruptPoints : a truncated or malformed file, numbers that are not finite, or a mesh without area.
    TooLarge : more points or triangles than the limit.
    """
    kind = kind_of(data)
    if kind is None:
        raise UnsupportedMedia(f"the body is not {NAMES} by its content", field="points")
    points = sample(_finite(MESHES[kind](data), kind), kind) if kind in MESHES else POINTS[kind](data)
    if len(points) > MAX_POINTS:
        raise TooLarge(f"the file has {len(points)} points, the limit is {MAX_POINTS}", field="points")
    return _finite(points, kind)


def sample(triangles: Doubles, kind: str) -> Doubles:
    """Return points uniform on triangles (t, 3, 3): (SAMPLES, 3). The same mesh gives the same points."""
    if len(triangles) > MAX_TRIANGLES:
        raise TooLarge(f"the mesh has {len(triangles)} triangles, the limit is {MAX_TRIANGLES}", field="points")
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    with np.errstate(over="ignore", invalid="ignore"):
        areas = np.linalg.norm(np.cross(first, second), axis=1).cumsum()
    if not len(areas) or not np.isfinite(areas[-1]) or areas[-1] <= 0:
        raise CorruptPoints(f"the {kind.upper()} mesh has no triangles, or its area is not a number", field="points")
    rng = np.random.default_rng(SEED)
    index = np.searchsorted(areas, rng.random(SAMPLES) * areas[-1], side="right").clip(max=len(areas) - 1)
    a, b = rng.random((2, SAMPLES, 1))
    a, b = np.where(a + b > 1, 1 - a, a), np.where(a + b > 1, 1 - b, b)
    points: Doubles = triangles[index, 0] + a * first[index] + b * second[index]
    return points


def _finite(points: Doubles, kind: str) -> Doubles:
    """Return numbers if all are finite and fit float32. Raises CorruptPoints."""
    if not (np.abs(points) <= np.finfo(np.float32).max).all():  # NaN is not
        raise CorruptPoints(f"the {kind.upper()} file has a coordinate that is no finite float32", field="points")
    return points


def _npy(data: bytes) -> Doubles:
    """Return the first three columns of an array (n, 3) or wider."""
    file = BytesIO(data)
    try:
        version = npy_format.read_magic(file)
        readers = {(1, 0): npy_format.read_array_header_1_0, (2, 0): npy_format.read_array_header_2_0}
        shape, is_fortran, dtype = readers[version](file)
    except (ValueError, KeyError) as error:
        raise CorruptPoints("the NPY file has a faulty header: save it with numpy.save", field="points") from error
    if dtype.kind not in "fiu" or len(shape) != 2 or shape[1] < 3:
        raise CorruptPoints(f"the NPY array is {dtype} {shape}, numbers of shape (n, 3) are needed", field="points")
    count, start = shape[0] * shape[1], file.tell()
    if len(data) - start != count * dtype.itemsize:
        raise CorruptPoints(f"the NPY file has {len(data)} bytes, its header says otherwise", field="points")
    array = np.frombuffer(data, dtype, offset=start).reshape(shape, order="F" if is_fortran else "C")
    return array[:, :3].astype(np.float64)


def _is_binary_stl(data: bytes) -> bool:
    count = int.from_bytes(data[80:STL_HEAD], "little")
    return len(data) >= STL_HEAD and len(data) == STL_HEAD + STL_TRIANGLE.itemsize * count


def _stl(data: bytes) -> Doubles:
    if not _is_binary_stl(data):
        return text.stl(data)
    return np.frombuffer(data, STL_TRIANGLE, offset=STL_HEAD)["corners"].astype(np.float64)


POINTS: Final[dict[str, Callable[[bytes], Doubles]]] = {"ply": ply.read, "pcd": pcd.read, "npy": _npy, "xyz": text.xyz}
MESHES: Final[dict[str, Callable[[bytes], Doubles]]] = {"glb": glb.read, "obj": text.obj, "stl": _stl}
