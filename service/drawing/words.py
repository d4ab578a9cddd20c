"""Words over two objects in a picture: for k = 2 the paper's tree, for larger k its gradient (Object Interpolation)."""

from collections.abc import Sequence
from typing import Final

from PIL import Image, ImageDraw, ImageFont

from service.drawing.cloud import draw
from service.mapping.spec import Array

Cell = tuple[str, Array]  # label, points (n, 3)

CELL: Final = 320  # pixels
LABEL: Final = 28
MAX_POINTS: Final = 100_000  # of a cell: more would only fill it


def rows_of_words(k: int) -> list[list[str]]:
    """The words over A and B that a sheet shows, k of 2 or more.

    k = 2 : a row for each function that may come first: it alone, and what either makes of that; A, AA, BA
        and B, AB, BB.
    k > 2 : one row from A to B: AAAA, AAAB, AABB, ABBB, BBBB.
    """
    if k == 2:
        return [["A", "AA", "BA"], ["B", "AB", "BB"]]
    return [["A" * (k - count) + "B" * count for count in range(k + 1)]]


def label(word: str, k: int) -> str:
    """A word, and what it computes: "AB = A(B(x))"; of one letter "A(x)"."""
    formula = f"{'('.join(word)}(x{')' * len(word)}"
    if len(word) == 1:
        return formula
    return f"{word} = {formula}, the object {word[0]}" if word == word[0] * k else f"{word} = {formula}"


def sheet(rows: Sequence[Sequence[Cell]], title: str = "", cell: int = CELL) -> Image.Image:
    """Clouds in rows, all seen from the same side, each under its label, in squares of `cell` pixels."""
    font = ImageFont.load_default(LABEL // 2)
    columns, top = max(map(len, rows)), LABEL if title else 0
    image = Image.new("RGB", (columns * cell, top + len(rows) * (LABEL + cell)), "white")
    pen = ImageDraw.Draw(image)
    pen.text((8, 6), title, "black", font)
    for row in rows:
        for column, (text, points) in enumerate(row):
            pen.text((column * cell + 8, top + 6), text, "black", font)
            image.paste(Image.fromarray(draw(points, cell)), (column * cell, top + LABEL))
        top += LABEL + cell
    return image
