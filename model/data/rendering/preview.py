"""Draw a contact sheet of a data set: some views of each object, and its points."""

from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from model.data.manifest import Manifest, variant_files
from service.drawing.cloud import draw

VIEWS_SHOWN: Final = (0, 3, 8, 14, 20)
VARIANT_VIEWS_SHOWN: Final = (0, 1, 2, 3, 4)
CELL: Final = 128
LABEL: Final = 14

Bytes = npt.NDArray[np.uint8]


def preview(data: Path, output: Path, objects: int, variants: bool = False) -> None:
    """Write a PNG with one row per object: five views over white, then its points.

    Objects are taken at even steps through the manifest, so that every source appears. With `variants`, the rows are
    the variants of these objects that `hof-model data vary` wrote.

    Raises
    ------
    FileNotFoundError : `data` holds no finished data set, or lacks the requested variants.
    """
    entries = Manifest.read(data).entries
    rows = []
    for entry in entries[:: max(1, len(entries) // objects)][:objects]:
        files = variant_files(data, entry) if variants else [data / entry.file]
        rows += [(f"{entry.id} ({entry.category}, {entry.split})", file) for file in files]
    sheet = Image.new("RGB", (CELL * (len(VIEWS_SHOWN) + 1), (CELL + LABEL) * len(rows)), "white")
    pen = ImageDraw.Draw(sheet)
    numbers = VARIANT_VIEWS_SHOWN if variants else VIEWS_SHOWN
    for row, (label, file) in enumerate(rows):
        with np.load(file) as arrays:
            views = arrays["views"]
            cells = [flatten(views[view % len(views)]) for view in numbers] + [draw(arrays["points"], CELL)]
        top = row * (CELL + LABEL)
        pen.text((2, top), label, fill="black")
        for column, cell in enumerate(cells):
            sheet.paste(Image.fromarray(cell).resize((CELL, CELL)), (column * CELL, top + LABEL))
    output.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(output)


def flatten(view: Bytes) -> Bytes:
    """Put an RGBA view over white: (S, S, 4) -> (S, S, 3) uint8."""
    alpha = view[..., 3:].astype(np.float32) / 255
    return (view[..., :3] * alpha + 255 * (1 - alpha)).astype(np.uint8)
