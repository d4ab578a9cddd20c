"""A cloud: points of one object and their colors, computed part by part, so that memory does not grow with n."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from service.mapping.canonical import Sampling, check_range
from service.mapping.color import ColorSampler
from service.mapping.frame import Frame
from service.mapping.pose import Pose
from service.mapping.sampler import CHUNK, Sampler
from service.mapping.spec import Array, Colors, Functions, MappingSpec, word_of

FIRST_PART: Final = CHUNK // 16  # points; few, so that the first byte is sent early
PART: Final = CHUNK  # points

Part = tuple[int, int]  # index of the first point, counted from the cloud's first; number of points


@dataclass(frozen=True)
class Cloud:
    """Points of one object: everything that determines their coordinates and colors.

    Parameters
    ----------
    spec, functions : the object.
    n, seed, offset, scale, sampling : as in `Sampler.points`.
    frame : as in `Sampler`.
    pose : the object before a camera, for points in the camera's frame; None for points in `frame`.

    Raises
    ------
    InvalidParameter : n, seed or offset is out of range.
    """

    spec: MappingSpec
    functions: Functions
    n: int
    seed: int = 0
    offset: int = 0
    scale: float = 1.0
    sampling: Sampling = "uniform"
    frame: Frame | None = None
    pose: Pose | None = None

    def __post_init__(self) -> None:
        check_range(self.n, self.seed, self.offset, self.sampling)

    @cached_property
    def sampler(self) -> Sampler:
        """The object's functions, packed once for all parts."""
        return Sampler(self.spec, word_of(self.spec, self.functions.theta), self.frame)

    @cached_property
    def color_sampler(self) -> ColorSampler:
        """The object's color functions, packed once for all parts. Raises ValueError if it has none."""
        if self.functions.color is None:
            raise ValueError("the object has no color")
        return ColorSampler(self.functions.color)

    def parts(self) -> Iterator[Part]:
        """Cut the points into parts, in order: a small first one, then parts of up to `PART` points."""
        start, size = 0, FIRST_PART
        while start < self.n:
            yield start, min(size, self.n - start)
            start, size = start + size, PART

    def points(self, part: Part) -> Array:
        """Compute the points of a part, (count, 3) float32, in the frame and times `scale` (paper, eq. 4)."""
        start, count = part
        offset = self.offset + start
        points = self.sampler.points(count, seed=self.seed, offset=offset, scale=self.scale, sampling=self.sampling)
        return self.pose.place(points, self.scale) if self.pose else points

    def colors(self, part: Part) -> Colors:
        """Compute the colors of a part's points, (count, 3) uint8, sRGB."""
        start, count = part
        return self.color_sampler.colors(count, seed=self.seed, offset=self.offset + start, sampling=self.sampling)


def bounds(chunks: Iterable[Array]) -> tuple[Array, Array]:
    """Return the smallest and the largest coordinates, (3,) and (3,) float32, of chunks of (m, 3) points.

    Raises
    ------
    ValueError : there are no points.
    """
    extremes = [(points.min(axis=0), points.max(axis=0)) for points in chunks]
    lows, highs = zip(*extremes, strict=True)
    return np.min(lows, axis=0), np.max(highs, axis=0)
