"""Point clouds held in arrays, and the formats that write them, with and without colors."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from service.formats.points.registry import POINT_FORMATS, PointFormat
from service.formats.points.writer import write
from service.mapping.cloud import Part
from service.mapping.spec import Array, Colors

FORMATS = list(POINT_FORMATS.values())
COLORED = [fmt.colored for fmt in FORMATS if fmt.colored]
EVERY = [*FORMATS, *COLORED]
BINARY = [fmt for fmt in EVERY if not fmt.is_text]
TEXT = [fmt for fmt in EVERY if fmt.is_text]
TWO = np.array([[0.5, -1, 0], [0.1, 2e-7, -123456.789]], np.float32)


@dataclass(frozen=True)
class ArrayCloud:
    """Cloud whose points, and colors if any, are arrays."""

    all_points: Array
    all_colors: Colors | None = None
    chunk: int = 1000

    @property
    def n(self) -> int:
        """Number of points."""
        return len(self.all_points)

    def parts(self) -> Iterator[Part]:
        """Yield the parts, of `chunk` points each but the last."""
        return ((at, min(self.chunk, self.n - at)) for at in range(0, self.n, self.chunk))

    def points(self, part: Part) -> Array:
        """Return the points of a part, (n, 3) float32."""
        return self.all_points[part[0] : sum(part)]

    def colors(self, part: Part) -> Colors:
        """Return the colors of a part, (n, 3) uint8."""
        assert self.all_colors is not None
        return self.all_colors[part[0] : sum(part)]


def file_of(fmt: PointFormat, points: Array, chunk: int = 1000) -> bytes:
    """Return a file of the points, with colors if the format takes them."""
    return b"".join(write(fmt, ArrayCloud(points, colors_of(len(points)), chunk)))


def colors_of(n: int) -> Colors:
    """Return n random colors, the same on every call."""
    return np.random.default_rng(0).integers(0, 256, (n, 3), np.uint8)


def label(fmt: PointFormat) -> str:
    """Return the id of a format in parametrized tests."""
    return f"{fmt.name}-in-color" if fmt in COLORED else fmt.name


def colored(name: str) -> PointFormat:
    """Return the variant with colors of a format."""
    fmt = POINT_FORMATS[name].colored
    assert fmt
    return fmt
