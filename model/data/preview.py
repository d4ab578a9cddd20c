"""A contact sheet of a data set: per object some of its views and its points."""

from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from model.data.manifest import Manifest
from service.picture import draw

VIEWS_SHOWN: Final = (0, 3, 8, 14, 20)
CELL: Final = 128
LABEL: Final = 14

Bytes = npt.NDArray[np.uint8]


def preview(data: Path, output: Path, objects: int) -> None:
    """Write a PNG with one row per object: five views over white, then its points.

    Objects are taken at even distances through the manifest, so that every source shows.

    Raises
    ------
    FileNotFoundError : `data` holds no finished data set.
    """
    entries = Manifest.read(data).entries
    chosen = entries[:: max(1, len(entries) // objects)][:objects]
    sheet = Image.new("RGB", (CELL * (len(VIEWS_SHOWN) + 1), (CELL + LABEL) * len(chosen)), "white")
    pen = ImageDraw.Draw(sheet)
    for row, entry in enumerate(chosen):
        with np.load(data / entry.file) as arrays:
            cells = [flatten(arrays["views"][view]) for view in VIEWS_SHOWN] + [draw(arrays["points"], CELL)]
        top = row * (CELL + LABEL)
        pen.text((2, top), f"{entry.id} ({entry.category}, {entry.split})", fill="black")
        for column, cell in enumerate(cells):
            sheet.paste(Image.fromarray(cell).resize((CELL, CELL)), (column * CELL, top + LABEL))
    output.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(output)


def flatten(view: Bytes) -> Bytes:
    """An RGBA view over white: (S, S, 4) -> (S, S, 3) uint8."""
    alpha = view[..., 3:].astype(np.float32) / 255
    return (view[..., :3] * alpha + 255 * (1 - alpha)).astype(np.uint8)
