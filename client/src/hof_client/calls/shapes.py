"""Calls for an object's shape: points as arrays or files, surfaces, pictures, weights."""

import io
from dataclasses import asdict, dataclass
from os import PathLike
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from hof_client.answers import Array
from hof_client.bodies import ColoredArrays, ColoredPoints, PointArray, PointChunks, ToFile, Whole
from hof_client.request import Call, Request, Stream, Value

PointFormat = Literal["ply", "npy", "xyz", "json", "glb", "gltf", "pcd", "f32", "f16"]
MeshFormat = Literal["glb", "gltf", "obj", "stl", "ply", "usdz"]
PictureFormat = Literal["png", "webp", "gif"]
PictureView = Literal["three-quarter", "front", "side", "back", "top"]
WeightFormat = Literal["safetensors", "npy", "json", "onnx"]
WeightType = Literal["float32", "float16", "int8"]
Frame = Literal["object", "raw", "camera"]
Sampling = Literal["uniform", "sobol"]
Color = Literal["auto", "none"]
Precision = Literal["float32", "float16"]

RAW = {"float32": ("f32", "<f4"), "float16": ("f16", "<f2")}  # format of the service, type of NumPy
BYTES = "application/octet-stream"


@dataclass(frozen=True, kw_only=True)
class Viewpoint:
    """The camera of `frame="camera"`. What is None is that of the object, if it has a camera.

    Attributes
    ----------
    azimuth, elevation, roll : degrees, as in `Camera`.
    distance : from the object's center, in its longest sides; by default, with `fx`, as its size in the photo tells.
    fx, fy : focal lengths in pixels of the upright photo; by default those with which the object, at the distance of
        the camera, fills its box in the photo.
    cx, cy : pixel at which the camera looks; by default the middle of the photo.
    """

    azimuth: float | None = None
    elevation: float | None = None
    distance: float | None = None
    roll: float | None = None
    fx: float | None = None
    fy: float | None = None
    cx: float | None = None
    cy: float | None = None


OWN = Viewpoint()


def points(
    object_id: str,
    n: int = 10_000,
    *,
    seed: int = 0,
    offset: int = 0,
    scale: float = 1.0,
    frame: Frame = "object",
    viewpoint: Viewpoint = OWN,
    sampling: Sampling = "uniform",
    precision: Precision = "float32",
) -> Call[NDArray[np.floating[Any]]]:
    """Return n points of an object, (n, 3), in the object frame: +Y up, the front faces +Z, centered.

    The first m points of n are those of m with the same seed. The array is allocated once and filled as bytes come.

    Parameters
    ----------
    n : 1 to 10,000,000.
    offset : points to skip: continues where an earlier call stopped.
    scale : length of the longest side of the whole object's box, for example in meters.
    frame : `object`; `raw` for the function's own numbers times `scale`; `camera` for that of the photo's camera,
        x right, y down, z forward.
    viewpoint : the camera of `frame="camera"`; by default the object's own.
    sampling : `uniform` draws independent points, `sobol` covers the object more evenly.
    precision : `float16` halves the bytes and keeps 3 digits.

    Raises
    ------
    NotFound, InvalidParameter : see `hof_client.problems`.
    Truncated : the answer broke off, repeats included.
    """
    request, dtype = _raw(object_id, n, precision, seed, offset, scale, frame, viewpoint, sampling)
    return Call(request, lambda _: PointArray(n, dtype))


def iter_points(
    object_id: str,
    n: int = 10_000,
    *,
    seed: int = 0,
    offset: int = 0,
    scale: float = 1.0,
    frame: Frame = "object",
    viewpoint: Viewpoint = OWN,
    sampling: Sampling = "uniform",
    precision: Precision = "float32",
) -> Stream[NDArray[np.floating[Any]]]:
    """Iterate over the points of `points` as they come, in read-only arrays (m, 3) of any size.

    Nothing is repeated once points have come. After `Truncated`, `offset` takes up where the iteration stopped.
    """
    request, dtype = _raw(object_id, n, precision, seed, offset, scale, frame, viewpoint, sampling)
    return Stream(request, lambda: PointChunks(n, dtype))


def colored_points(
    object_id: str,
    n: int = 10_000,
    *,
    seed: int = 0,
    offset: int = 0,
    scale: float = 1.0,
    frame: Frame = "object",
    viewpoint: Viewpoint = OWN,
    sampling: Sampling = "uniform",
) -> Call[ColoredPoints]:
    """Return n points of an object and their colors. Parameters and errors as in `points`."""
    query = _query(n, seed, offset, scale, frame, viewpoint, sampling) | {"format": "ply"}
    request = Request("GET", "/objects/{id}/points", {"id": object_id}, query, media_type="model/ply")
    return Call(request, lambda _: ColoredArrays(n))


def save_points(
    object_id: str,
    path: str | PathLike[str],
    n: int = 10_000,
    *,
    seed: int = 0,
    offset: int = 0,
    scale: float = 1.0,
    frame: Frame = "object",
    viewpoint: Viewpoint = OWN,
    sampling: Sampling = "uniform",
    color: Color = "auto",
    format: PointFormat | None = None,  # noqa: A002 - the name in the API
) -> Call[Path]:
    """Write n points of an object to a file as they come; return its path.

    The file appears when it is complete. Without `format` the path's suffix selects the format; the other parameters
    are those of `points`.
    """
    name = format or Path(path).suffix.removeprefix(".")
    if name not in get_args(PointFormat):
        raise ValueError(f"{name!r} of {path} is no format of points: give one of {', '.join(get_args(PointFormat))}")
    query = _query(n, seed, offset, scale, frame, viewpoint, sampling) | {"color": color, "format": name}
    request = Request("GET", "/objects/{id}/points", {"id": object_id}, query, media_type="")
    return Call(request, lambda _: ToFile(Path(path)))


def mesh(
    object_id: str,
    *,
    format: MeshFormat = "glb",  # noqa: A002 - the name in the API
    resolution: int = 64,
    scale: float = 1.0,
    frame: Frame = "object",
    viewpoint: Viewpoint = OWN,
    color: Color = "auto",
) -> Call[bytes]:
    """Return the file of an object's surface, of at most 20 resolution^2 triangles. Raises NotFound."""
    query = {"format": format, "resolution": resolution, "scale": scale, "frame": frame, "color": color}
    query |= asdict(viewpoint)
    request = Request("GET", "/objects/{id}/mesh", {"id": object_id}, query, media_type="")
    return Call(request, lambda _: Whole(bytes))


def picture(
    object_id: str,
    *,
    format: PictureFormat = "png",  # noqa: A002 - the name in the API
    size: int = 320,
    view: PictureView = "three-quarter",
    frames: int = 1,
    color: Color = "auto",
) -> Call[bytes]:
    """Return the file of a picture of an object, of size x size pixels. Raises NotFound.

    With more than one of `frames`, up to 36, the object turns once around: for `webp` and `gif`, and a size up to 320.
    """
    query = {"format": format, "size": size, "view": view, "frames": frames, "color": color}
    request = Request("GET", "/objects/{id}/picture", {"id": object_id}, query, media_type="")
    return Call(request, lambda _: Whole(bytes))


def photo(object_id: str) -> Call[bytes]:
    """Return a WebP of an object as its photo shows it, if `encode` was to keep that. Raises NotFound."""
    request = Request("GET", "/objects/{id}/photo", {"id": object_id}, media_type="image/webp")
    return Call(request, lambda _: Whole(bytes))


def weights(
    object_id: str,
    *,
    format: WeightFormat = "safetensors",  # noqa: A002 - the name in the API
    dtype: WeightType = "float32",
) -> Call[bytes]:
    """Return the file of an object's weights; `import_object` takes safetensors. Raises NotFound.

    `float16` halves the bytes and `int8` quarters them, for safetensors alone: other formats raise InvalidParameter.
    """
    query = {"format": format, "dtype": dtype}
    request = Request("GET", "/objects/{id}/weights", {"id": object_id}, query, media_type="")
    return Call(request, lambda _: Whole(bytes))


def theta(object_id: str) -> Call[Array]:
    """Return theta, (spec.size,) float32; of a composed object (spec.k, spec.size). Raises NotFound."""
    request = Request("GET", "/objects/{id}/weights", {"id": object_id}, {"format": "npy"}, media_type="")
    return Call(request, lambda _: Whole(lambda body: np.load(io.BytesIO(body), allow_pickle=False)))


def _raw(
    object_id: str,
    n: int,
    precision: Precision,
    seed: int,
    offset: int,
    scale: float,
    frame: Frame,
    viewpoint: Viewpoint,
    sampling: Sampling,
) -> tuple[Request, str]:
    """Return the request for bare coordinates, and their type."""
    if n < 1:
        raise ValueError(f"n is {n}: it must be at least 1")
    format_, dtype = RAW[precision]
    query = _query(n, seed, offset, scale, frame, viewpoint, sampling) | {"format": format_}
    return Request("GET", "/objects/{id}/points", {"id": object_id}, query, media_type=BYTES), dtype


def _query(
    n: int, seed: int, offset: int, scale: float, frame: Frame, viewpoint: Viewpoint, sampling: Sampling
) -> dict[str, Value]:
    query = {"n": n, "seed": seed, "offset": offset, "scale": scale, "frame": frame, "sampling": sampling}
    return query | asdict(viewpoint)
