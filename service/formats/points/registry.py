"""The file formats of point clouds."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, Protocol

from service.errors import InvalidParameter
from service.formats import raw
from service.formats.points import gltf, json, npy, pcd, ply, xyz
from service.mapping.cloud import Part
from service.mapping.spec import Array, Colors


class Source(Protocol):
    """Points that are computed part by part, and again for another pass, so that memory does not grow with n."""

    @property
    def n(self) -> int:
        """Number of points."""

    def parts(self) -> Iterator[Part]:
        """Return the parts, which cover all points in order."""

    def points(self, part: Part) -> Array:
        """Compute the points of a part, (count, 3) float32."""

    def colors(self, part: Part) -> Colors:
        """Compute the colors of a part's points, (count, 3) uint8, sRGB."""


Body = Callable[[Source, Part], bytes]


@dataclass(frozen=True)
class PointFormat:
    """A file format for point clouds: pure functions from arrays to bytes.

    name : value of the query parameter `format`.
    media_type : value of Content-Type and Accept.
    extension : of the file's name, with its dot.
    head : (n, bounds) -> the bytes before the points; bounds is None unless `needs_bounds`.
    passes : runs over all parts, one after another: the bytes before the first part, and the function that writes
        a part.
    tail : n -> the bytes after the points.
    length : n -> bytes of the whole file; None if the length depends on the points.
    needs_bounds : the head contains the smallest and largest coordinates.
    max_points : the format's limit; None if it has none.
    separator : the bytes between one part and the next.
    is_text : gzip shrinks the file to less than half; binary formats hardly shrink.
    colored : the variant with a color for each point; None if the format has no colors.
    in_camera_frame : the variant for points in a camera's frame; None if the file does not tell its axes.
    """

    name: str
    media_type: str
    extension: str
    head: Callable[[int, tuple[Array, Array] | None], bytes]
    passes: tuple[tuple[bytes, Body], ...]
    tail: Callable[[int], bytes] = lambda n: b""
    length: Callable[[int], int | None] = lambda n: None
    needs_bounds: bool = False
    max_points: int | None = None
    separator: bytes = b""
    is_text: bool = False
    colored: "PointFormat | None" = None
    in_camera_frame: "PointFormat | None" = None

    def holding(self, *, color: bool, camera: bool = False) -> "PointFormat":
        """Return the variant for points with a color, or in a camera's frame; this format if there is none."""
        fmt = self.colored or self if color else self
        return fmt.in_camera_frame or fmt if camera else fmt

    def check_count(self, n: int) -> None:
        """Raise InvalidParameter unless the format can hold n points."""
        if n < 1:
            raise InvalidParameter(f"n is {n}, it must be at least 1", field="n")
        if self.max_points is not None and n > self.max_points:
            raise InvalidParameter(f"n is {n}, {self.name} holds at most {self.max_points} points", field="n")


def _points(write: Callable[[Array], bytes]) -> tuple[bytes, Body]:
    """Return a pass that writes points."""
    return b"", lambda source, part: write(source.points(part))


def _colored_points(write: Callable[[Array, Colors], bytes]) -> tuple[bytes, Body]:
    """Return a pass that writes each point and its color."""
    return b"", lambda source, part: write(source.points(part), source.colors(part))


def _ply(*, colored: bool, camera: bool = False) -> PointFormat:
    """Return a variant of PLY; those in the object frame know theirs in a camera's frame."""
    passes = (_colored_points(ply.colored_body) if colored else _points(raw.float32),)
    head, length = (
        partial(ply.head, colored=colored, camera=camera),
        partial(ply.length, colored=colored, camera=camera),
    )
    other = None if camera else _ply(colored=colored, camera=True)
    return PointFormat("ply", "model/ply", ".ply", head, passes, length=length, in_camera_frame=other)


_NPY = PointFormat("npy", "application/x-npy", ".npy", npy.head, (_points(raw.float32),), length=npy.length)
_XYZ = PointFormat("xyz", "text/plain", ".xyz", xyz.head, (_points(xyz.body),), is_text=True)
_JSON = PointFormat(
    "json",
    "application/json",
    ".json",
    json.head,
    (_points(json.body),),
    json.tail,
    max_points=json.MAX_POINTS,
    separator=json.SEPARATOR,
    is_text=True,
)
_COLORED_JSON = replace(
    _JSON,
    passes=(*_JSON.passes, (json.COLORS, lambda source, part: json.colors(source.colors(part)))),
)
_GLB = PointFormat(
    "glb",
    "model/gltf-binary",
    ".glb",
    gltf.head,
    (_points(raw.float32),),
    length=gltf.length,
    needs_bounds=True,
    max_points=gltf.max_points(),
)
_COLORED_GLB = replace(
    _GLB,
    head=partial(gltf.head, stride=gltf.COLORED),
    passes=(_colored_points(gltf.colored_body),),
    length=partial(gltf.length, stride=gltf.COLORED),
    max_points=gltf.max_points(gltf.COLORED),
)
_GLTF = PointFormat(
    "gltf",
    "model/gltf+json",
    ".gltf",
    gltf.json_head,
    (_points(gltf.json_body),),
    gltf.json_tail,
    gltf.json_length,
    needs_bounds=True,
)
_COLORED_GLTF = replace(
    _GLTF,
    head=partial(gltf.json_head, stride=gltf.COLORED),
    passes=(_colored_points(gltf.colored_json_body),),
    length=partial(gltf.json_length, stride=gltf.COLORED),
)
_PCD = PointFormat("pcd", "application/x-pcd", ".pcd", pcd.head, (_points(raw.float32),), length=pcd.length)
_COLORED_PCD = replace(
    _PCD,
    head=partial(pcd.head, colored=True),
    passes=(_colored_points(pcd.colored_body),),
    length=partial(pcd.length, colored=True),
)
_F32 = PointFormat(
    "f32", "application/octet-stream", ".f32", raw.head, (_points(raw.float32),), length=lambda n: 12 * n
)
_F16 = PointFormat("f16", "application/octet-stream", ".f16", raw.head, (_points(raw.float16),), length=lambda n: 6 * n)

POINT_FORMATS: Final[Mapping[str, PointFormat]] = {
    fmt.name: fmt
    for fmt in (
        replace(_ply(colored=False), colored=_ply(colored=True)),
        _NPY,
        _XYZ,
        replace(_JSON, colored=_COLORED_JSON),
        replace(_GLB, colored=_COLORED_GLB),
        replace(_GLTF, colored=_COLORED_GLTF),
        replace(_PCD, colored=_COLORED_PCD),
        _F32,
        _F16,
    )
}
