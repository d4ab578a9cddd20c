"""A split as a few tensors that fit a device's memory: views, quantized points, and what is drawn together."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from model.data.packed.cameras import read_cameras
from model.data.packed.shards import MADE_SOURCE, SCALE, SHARDS, Bytes, Floats, Row, read_table
from model.data.packed.strips import decode


@dataclass(frozen=True)
class Tensors:
    """A split's shapes in memory, on one device.

    images : (views, S, S, 4) uint8 RGBA, framed by the service's code.
    shape_of : (views,) int64, which shape a view shows.
    points : (all points, 3) int16, see `dequantize`; those of a shape follow each other in random order.
    colors : (all points, 3) uint8, sRGB; None where some shape has none.
    starts, counts : (shapes,) int64, where a shape's points start and how many there are.
    units : (units, 3) int64: of each object or group of made pieces its first view, the end of its own shapes'
        views and the end of all its views; own shapes come first.
    cameras : (views, 2) float32, azimuth and elevation in degrees; None where they were not asked for.
    """

    images: Tensor
    shape_of: Tensor
    points: Tensor
    colors: Tensor | None
    starts: Tensor
    counts: Tensor
    units: Tensor
    cameras: Tensor | None = None

    def to(self, device: torch.device) -> "Tensors":
        """Return the same on a device."""
        return replace(
            self, **{name: value.to(device) for name, value in vars(self).items() if isinstance(value, Tensor)}
        )

    @property
    def gigabytes(self) -> float:
        """Return how much memory they take, in 10^9 bytes."""
        return sum(value.nbytes for value in vars(self).values() if isinstance(value, Tensor)) / 1e9


def dequantize(points: Tensor) -> Tensor:
    """Return int16 points as float32 in the object frame."""
    return points.float() / SCALE


def read_packed(
    folder: Path,
    split: str,
    side: int,
    workers: int,
    variants: bool = True,
    made: bool = True,
    with_cameras: bool = False,
) -> Tensors:
    """Read a split's shapes from all shards in `folder`, views of `side` pixels.

    Without `variants` of objects only their shapes as built are read, without `made` no made pieces. With
    `with_cameras` only shapes whose cameras are known.

    Raises
    ------
    FileNotFoundError : the folder holds no shards, or none of them holds the split.
    ValueError : a file is no shard, or a shard was cut off.
    """
    shards = sorted(folder.glob(SHARDS))
    if not shards:
        raise FileNotFoundError(f"{folder} holds no shards: run `hof-model data pack -o {folder}` first")
    cameras_of = read_cameras(folder) if with_cameras else None
    shapes = [
        shape
        for path in shards
        for shape in _shapes(path)
        if _is_wanted(shape[0], split, variants, made) and (cameras_of is None or shape[0].key in cameras_of)
    ]
    if not shapes:
        raise FileNotFoundError(f"the shards in {folder} hold nothing of the split {split}")
    rows, strips, points, colors = (list(column) for column in zip(*shapes, strict=True))
    cameras = [cameras_of[row.key][list(row.views)] for row in rows] if cameras_of else []
    return arrange(
        rows,
        decode(strips, side, workers),
        np.concatenate(points),
        np.concatenate(colors) if all(row.colored for row in rows) else None,
        np.concatenate(cameras) if cameras else None,
    )


def _is_wanted(row: Row, split: str, variants: bool, made: bool) -> bool:
    return row.split == split and (made if row.source == MADE_SOURCE else variants or row.shape == 0)


def _shapes(path: Path) -> list[tuple[Row, bytes, npt.NDArray[np.int16], Bytes]]:
    """Return a shard's shapes: row, strip, points, colors."""
    _, rows = read_table(path)
    with np.load(path) as arrays:
        strips, lengths, points, colors = (arrays[name] for name in ("strips", "lengths", "points", "colors"))
    if len(rows) != len(lengths) or len(strips) != lengths.sum() or len(points) != sum(row.points for row in rows):
        raise ValueError(f"{path} does not hold what its table says: copy or pack it again")
    data, ends, point_ends = strips.tobytes(), np.cumsum(lengths), np.cumsum([row.points for row in rows])
    return [
        (
            row,
            data[end - length : end],
            points[point_end - row.points : point_end],
            colors[point_end - row.points : point_end],
        )
        for row, end, length, point_end in zip(rows, ends.tolist(), lengths.tolist(), point_ends.tolist(), strict=True)
    ]


def arrange(
    rows: Sequence[Row],
    images: Bytes,
    points: npt.NDArray[np.int16],
    colors: Bytes | None,
    cameras: Floats | None = None,
) -> Tensors:
    """Arrange shapes, their views and points concatenated in the order of the rows, for drawing."""
    views, counts = (np.array(each, np.int64) for each in zip(*((len(r.views), r.points) for r in rows), strict=True))
    units, first = [], 0
    for _, group in groupby(rows, key=lambda row: row.unit):
        shapes = list(group)
        own_end = first + sum(len(row.views) for row in shapes if row.is_own)
        end = first + sum(len(row.views) for row in shapes)
        units.append((first, own_end, end))
        first = end
    return Tensors(
        images=torch.from_numpy(images),
        shape_of=torch.from_numpy(np.repeat(np.arange(len(rows)), views)),
        points=torch.from_numpy(points),
        colors=None if colors is None else torch.from_numpy(colors),
        starts=torch.from_numpy(np.cumsum(counts) - counts),
        counts=torch.from_numpy(counts),
        units=torch.tensor(units),
        cameras=None if cameras is None else torch.from_numpy(cameras),
    )
