"""Contact sheets: image, truth and prediction side by side."""

from collections.abc import Sequence
from typing import Final

from PIL import Image, ImageDraw

from model.data.rendering.preview import flatten
from model.evaluation.classes import EVERYDAY, class_of
from model.evaluation.evaluate import VIEWS, Case, predict
from service.drawing.cloud import draw
from service.encoding.encoder import Encoder

CELL: Final = 160
LABEL: Final = 16
SHOWN: Final = 24  # objects of the first sheet
SHOWN_PER_CLASS: Final = 8
COLUMNS: Final = 2  # objects side by side


def first_objects(encoder: Encoder, objects: Sequence[Case]) -> Image.Image:
    """Draw the split's first objects, in manifest order."""
    return _sheet(encoder, [(case.entry.id, case) for case in objects[:SHOWN]])


def everyday_objects(encoder: Encoder, objects: Sequence[Case]) -> Image.Image:
    """Draw the first objects of each class of everyday furniture, in manifest order."""
    labeled = []
    for name in EVERYDAY:
        of_class = [case for case in objects if class_of(case.entry) == name][:SHOWN_PER_CLASS]
        labeled += [(f"{name}: {case.entry.id}", case) for case in of_class]
    return _sheet(encoder, labeled)


def _sheet(encoder: Encoder, labeled: Sequence[tuple[str, Case]]) -> Image.Image:
    rows = -(-len(labeled) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * 3 * CELL, rows * (CELL + LABEL)), "white")
    pen = ImageDraw.Draw(sheet)
    for index, (label, case) in enumerate(labeled):
        left, top = index % COLUMNS * 3 * CELL, index // COLUMNS * (CELL + LABEL)
        pen.text((left + 2, top), f"{label}: image, truth, prediction", fill="black")
        for column, cell in enumerate(_cells(encoder, case)):
            sheet.paste(cell, (left + column * CELL, top + LABEL))
    return sheet


def _cells(encoder: Encoder, case: Case) -> list[Image.Image]:
    view = case.views[VIEWS[0]]
    clouds = (case.points, predict(encoder, view))
    return [Image.fromarray(flatten(view)).resize((CELL, CELL))] + [Image.fromarray(draw(c, CELL)) for c in clouds]
