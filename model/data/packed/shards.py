"""The format of a packed data set: WebP strips of views, points as 16-bit integers, a table of shapes.

A shard is an uncompressed .npz file that stands on its own, so that a reader may have some of a set's shards:

- `strips`, `lengths`: one WebP image per shape, its views beside each other, concatenated; bytes of each.
- `points`: (n, 3) int16, coordinate times SCALE, of all shapes in order; the order within a shape is random.
- `colors`: (n, 3) uint8, sRGB of each point, zeros for shapes that have none.
- `table`: JSON, `{"format": 1, "options": {...}, "shapes": [row, ...]}`; a row holds the fields of `Row`.

`index.json` beside the shards tells the options, and of each shard its SHA-256, bytes, shapes and views per split.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, BinaryIO, Final
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

Bytes = npt.NDArray[np.uint8]
Floats = npt.NDArray[np.float32]
Shorts = npt.NDArray[np.int16]

FORMAT: Final = 1
OWN: Final = 2  # an object's first shapes: as built, and under free cameras
MADE_SOURCE: Final = "made"
INDEX: Final = "index.json"
SHARDS: Final = "shard-*.npz"
SCALE: Final = 65_534  # of a coordinate in [-0.5, 0.5]: errors stay below 1e-5 of the longest side
MARGIN: Final = 1e-3  # longest sides by which a point may lie outside the object's box


@dataclass(frozen=True)
class Row:
    """One shape of a shard.

    unit : shapes of equal unit, which follow each other, are drawn as one: an object, or a group of made pieces.
    object, source, split : of the manifest; a made piece has its file's name and MADE_SOURCE.
    shape : 0 as built, 1 under free cameras, above that variants; made pieces have OWN.
    views : the numbers of its views in the data set.
    points : how many points it has.
    colored : whether its points have colors.
    """

    unit: str
    object: str
    source: str
    split: str
    shape: int
    views: tuple[int, ...]
    points: int
    colored: bool

    @property
    def key(self) -> str:
        """Name of the shape in its packed data set."""
        return f"{self.unit}|{self.object}|{self.shape}"

    @property
    def is_own(self) -> bool:
        """Return whether this is an object's own shape."""
        return self.shape < OWN


@dataclass(frozen=True)
class PackedShape:
    """A shape as a shard stores it: its row, its views as WebP, `quantize`d points (n, 3) and colors (n, 3)."""

    row: Row
    strip: bytes
    points: Shorts
    colors: Bytes

    @property
    def size(self) -> int:
        """Bytes that it takes in a shard, its row included."""
        return len(self.strip) + self.points.nbytes + self.colors.nbytes + len(json.dumps(asdict(self.row)))


def quantize(points: Floats) -> Shorts:
    """Round points in the object frame to multiples of 1 / SCALE: (n, 3) float32 -> (n, 3) int16.

    Raises
    ------
    ValueError : a point lies outside the object's box.
    """
    reach = float(np.abs(points).max())
    if reach > 0.5 + MARGIN:
        raise ValueError(f"a coordinate is {reach:.4f} from the center, at most 0.5 is possible in the object frame")
    whole: Shorts = np.rint(points.clip(-0.5, 0.5) * SCALE).astype(np.int16)
    return whole


def write_shard(file: BinaryIO, shapes: list[PackedShape], options: dict[str, Any]) -> None:
    """Write shapes as one shard; equal shapes and options give equal bytes."""
    table = {"format": FORMAT, "options": options, "shapes": [asdict(shape.row) for shape in shapes]}
    np.savez(
        file,
        strips=np.frombuffer(b"".join(shape.strip for shape in shapes), np.uint8),
        lengths=np.array([len(shape.strip) for shape in shapes], np.int64),
        points=np.concatenate([shape.points for shape in shapes]),
        colors=np.concatenate([shape.colors for shape in shapes]),
        table=np.frombuffer(json.dumps(table).encode(), np.uint8),
    )


def read_table(path: Path) -> tuple[dict[str, Any], list[Row]]:
    """Read a shard's options and rows.

    Raises
    ------
    ValueError : the file is no shard of this format.
    """
    try:
        with path.open("rb") as file, np.load(file) as arrays:
            table = json.loads(arrays["table"].tobytes())
        rows = [Row(**{**row, "views": tuple(row["views"])}) for row in table["shapes"]]
        options = dict(table["options"])
    except (KeyError, TypeError, ValueError, EOFError, BadZipFile) as error:
        raise ValueError(f"{path} is no shard of `hof-model data pack`: {error!r}") from error
    if table.get("format") != FORMAT:
        raise ValueError(f"{path} has format {table.get('format')}, this version reads {FORMAT}: pack again")
    return options, rows
