"""Point clouds as files: what formats there are, how one is chosen, how one is written piece by piece."""

from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Final, Protocol, TypeVar

from service.errors import InvalidParameter, NotAcceptable
from service.formats import gltf, json, npy, pcd, ply, raw, xyz
from service.mapping import Array
from service.sampler import bounds as bounds_of


class _Format(Protocol):
    @property
    def media_type(self) -> str: ...
    @property
    def extension(self) -> str: ...


Format = TypeVar("Format", bound=_Format)


@dataclass(frozen=True)
class PointFormat:
    """A file format for point clouds: pure functions from arrays to bytes.

    name : as in the query's `format`.
    media_type : as in Content-Type and Accept.
    extension : of a file's name, with its dot.
    head : (n, bounds) -> what precedes the points; bounds are None unless `needs_bounds`.
    body : points (m, 3) float32 -> bytes.
    tail : n -> what follows the points.
    length : n -> bytes of the whole file, None where only the points tell.
    needs_bounds : the head holds the smallest and largest coordinates.
    max_points : the format's limit, None without one.
    separator : what stands between one body and the next.
    is_text : it shrinks to less than half by gzip; the others hardly do.
    """

    name: str
    media_type: str
    extension: str
    head: Callable[[int, tuple[Array, Array] | None], bytes]
    body: Callable[[Array], bytes]
    tail: Callable[[int], bytes] = lambda n: b""
    length: Callable[[int], int | None] = lambda n: None
    needs_bounds: bool = False
    max_points: int | None = None
    separator: bytes = b""
    is_text: bool = False


_PLY = PointFormat("ply", "model/ply", ".ply", ply.head, raw.float32, length=ply.length)
_NPY = PointFormat("npy", "application/x-npy", ".npy", npy.head, raw.float32, length=npy.length)
_XYZ = PointFormat("xyz", "text/plain", ".xyz", xyz.head, xyz.body, is_text=True)
_JSON = PointFormat(
    "json",
    "application/json",
    ".json",
    json.head,
    json.body,
    json.tail,
    max_points=json.MAX_POINTS,
    separator=json.SEPARATOR,
    is_text=True,
)
_GLB = PointFormat(
    "glb",
    "model/gltf-binary",
    ".glb",
    gltf.head,
    raw.float32,
    length=gltf.length,
    needs_bounds=True,
    max_points=gltf.MAX_POINTS,
)
_GLTF = PointFormat(
    "gltf",
    "model/gltf+json",
    ".gltf",
    gltf.json_head,
    gltf.json_body,
    gltf.json_tail,
    gltf.json_length,
    needs_bounds=True,
)
_PCD = PointFormat("pcd", "application/x-pcd", ".pcd", pcd.head, raw.float32, length=pcd.length)
_F32 = PointFormat("f32", "application/octet-stream", ".f32", raw.head, raw.float32, length=lambda n: 12 * n)
_F16 = PointFormat("f16", "application/octet-stream", ".f16", raw.head, raw.float16, length=lambda n: 6 * n)

POINT_FORMATS: Final[Mapping[str, PointFormat]] = {
    fmt.name: fmt for fmt in (_PLY, _NPY, _XYZ, _JSON, _GLB, _GLTF, _PCD, _F32, _F16)
}


def write(fmt: PointFormat, n: int, chunks: Callable[[], Iterator[Array]]) -> Iterator[bytes]:
    """The file, piece by piece: head, one piece of bytes for each chunk of points, tail.

    Parameters
    ----------
    fmt : the format.
    n : how many points `chunks` gives in all.
    chunks : starts an iterator of (m, 3) float32. Called twice where the format needs bounds, so that
        memory does not grow with n.

    Raises
    ------
    InvalidParameter : n is not within the format's limit.
    """
    if n < 1:
        raise InvalidParameter(f"n must be at least 1, not {n}", field="n")
    if fmt.max_points is not None and n > fmt.max_points:
        raise InvalidParameter(f"{fmt.name} holds at most {fmt.max_points} points, not {n}", field="n")
    return filter(None, _pieces(fmt, n, chunks))  # an empty piece would end a chunked HTTP body


def negotiate(accept: str | None, formats: Collection[Format]) -> Format:
    """The format that an Accept header (RFC 9110, section 12.5.1) asks for; the first where it leaves the choice.

    The highest q wins; then the more exact range, then the one that is named first.

    Raises
    ------
    NotAcceptable : the header allows no format that we write.
    """
    ranges = _media_ranges(accept or "*/*")
    ranked = [
        (q, exactness, earliness, fmt)
        for fmt in formats
        for exactness, q, earliness in [_match(fmt.media_type, ranges)]
        if q > 0
    ]
    if not ranked:
        offered = ", ".join(fmt.media_type for fmt in formats)
        raise NotAcceptable(f"the Accept header allows none of {offered}", field="Accept")
    return max(ranked, key=lambda candidate: candidate[:3])[3]  # max keeps the first of equals


def _pieces(fmt: PointFormat, n: int, chunks: Callable[[], Iterator[Array]]) -> Iterator[bytes]:
    yield fmt.head(n, bounds_of(chunks()) if fmt.needs_bounds else None)
    separator = b""
    for points in chunks():
        yield separator + fmt.body(points)
        separator = fmt.separator
    yield fmt.tail(n)


def _media_ranges(accept: str) -> list[tuple[str, float]]:
    """(range, q) in the header's order; what makes no sense is left out."""
    ranges = []
    for part in accept.lower().split(","):
        media_range, *parameters = (field.strip() for field in part.split(";"))
        quality = next((value[2:] for value in parameters if value.startswith("q=")), "1")
        try:
            q = float(quality)
        except ValueError:
            continue
        if "/" in media_range and 0 <= q <= 1:
            ranges.append((media_range, q))
    return ranges


def _match(media_type: str, ranges: list[tuple[str, float]]) -> tuple[int, float, int]:
    """The most exact range that covers a media type, as (exactness, q, earliness); q = 0 for none."""
    covers = (media_type, media_type.split("/")[0] + "/*", "*/*")
    return max(
        (
            (len(covers) - covers.index(media_range), q, -position)
            for position, (media_range, q) in enumerate(ranges)
            if media_range in covers
        ),
        default=(0, 0.0, 0),
    )
