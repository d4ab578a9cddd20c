"""Point clouds as files: what formats there are, how one is written piece by piece."""

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
    """Points that are computed part by part, and again in another pass, so that memory does not grow with n."""

    @property
    def n(self) -> int:
        """How many points there are in all."""

    def parts(self) -> Iterator[Part]:
        """All points in order."""

    def points(self, part: Part) -> Array:
        """Points of a part, (count, 3) float32."""

    def colors(self, part: Part) -> Colors:
        """Their colours, (count, 3) uint8, sRGB."""


Body = Callable[[Source, Part], bytes]


@dataclass(frozen=True)
class PointFormat:
    """A file format for point clouds: pure functions from arrays to bytes.

    name : as in the query's `format`.
    media_type : as in Content-Type and Accept.
    extension : of a file's name, with its dot.
    head : (n, bounds) -> what precedes the points; bounds are None unless `needs_bounds`.
    passes : over all parts, one after another: what stands before the pass, and what writes a part.
    tail : n -> what follows the points.
    length : n -> bytes of the whole file, None where only the points tell.
    needs_bounds : the head holds the smallest and largest coordinates.
    max_points : the format's limit, None without one.
    separator : what stands between one part and the next.
    is_text : it shrinks to less than half by gzip; the others hardly do.
    colored : the format with a colour for each point; None where it holds none.
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

    def holding(self, *, color: bool) -> "PointFormat":
        """This format, with colours where there are any and it can hold them."""
        return self.colored or self if color else self

    def check_count(self, n: int) -> None:
        """Refuse a number of points that the format cannot hold, with InvalidParameter."""
        if n < 1:
            raise InvalidParameter(f"n is {n}, the least is 1", field="n")
        if self.max_points is not None and n > self.max_points:
            raise InvalidParameter(f"n is {n}, {self.name} holds at most {self.max_points} points", field="n")


def _points(write: Callable[[Array], bytes]) -> tuple[bytes, Body]:
    return b"", lambda source, part: write(source.points(part))


def _colored_points(write: Callable[[Array, Colors], bytes]) -> tuple[bytes, Body]:
    return b"", lambda source, part: write(source.points(part), source.colors(part))


_PLY = PointFormat("ply", "model/ply", ".ply", ply.head, (_points(raw.float32),), length=ply.length)
_COLORED_PLY = replace(
    _PLY,
    head=partial(ply.head, colored=True),
    passes=(_colored_points(ply.colored_body),),
    length=partial(ply.length, colored=True),
)
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
        replace(_PLY, colored=_COLORED_PLY),
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
