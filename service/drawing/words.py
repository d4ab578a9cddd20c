"""A picture of the words over two objects: for k = 2 the paper's tree, else its gradient (Object Interpolation)."""

from collections.abc import Sequence
from typing import Final

from PIL import Image, ImageDraw, ImageFont

from service.drawing.cloud import draw
from service.mapping.spec import Array, Colors

Cell = tuple[str, Array, Colors | None]  # label, points (n, 3), their colors (n, 3) if they have any

CELL: Final = 320  # side of a cell, pixels
LABEL: Final = 28  # height of a label, pixels
MAX_POINTS: Final = 100_000  # of a cell; more would not be visible


def rows_of_words(k: int) -> list[list[str]]:
    """Return the words over A and B that a sheet shows, for k of 2 or more.

    k = 2 : a row for each function that is applied first: that function alone, then either function after it:
        A, AA, BA and B, AB, BB.
    k > 2 : one row from A to B: AAAA, AAAB, AABB, ABBB, BBBB.
    """
    if k == 2:
        return [["A", "AA", "BA"], ["B", "AB", "BB"]]
    return [["A" * (k - count) + "B" * count for count in range(k + 1)]]


def label(word: str, k: int) -> str:
    """Return a word with its formula, "AB = A(B(x))"; for one letter the formula alone, "A(x)"."""
    formula = f"{'('.join(word)}(x{')' * len(word)}"
    if len(word) == 1:
        return formula
    return f"{word} = {formula}, the object {word[0]}" if word == word[0] * k else f"{word} = {formula}"


def sheet(rows: Sequence[Sequence[Cell]], title: str = "", cell: int = CELL) -> Image.Image:
    """Draw clouds in rows, all from the same side, each under its label, in squares of `cell` pixels."""
    font = ImageFont.load_default(LABEL // 2)
    columns, top = max(map(len, rows)), LABEL if title else 0
    image = Image.new("RGB", (columns * cell, top + len(rows) * (LABEL + cell)), "white")
    pen = ImageDraw.Draw(image)
    pen.text((8, 6), title, "black", font)
    for row in rows:
        for column, (text, points, colors) in enumerate(row):
            pen.text((column * cell + 8, top + 6), text, "black", font)
            image.paste(Image.fromarray(draw(points, cell, colors=colors)), (column * cell, top + LABEL))
        top += LABEL + cell
    return image
