"""Pictures of words: the words, their cells and their functions."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from service.cli.main import main
from service.drawing.cloud import draw
from service.drawing.words import CELL, LABEL, label, rows_of_words, sheet
from service.formats.weights import Weights, dump
from service.mapping.box import measure
from service.mapping.canonical import canonical_points
from service.mapping.spec import Color, MappingSpec, compose, initial_theta

N = 2_000


def _spec(k: int) -> MappingSpec:
    return MappingSpec("tiny", 3, (16,), 3, k=k)


def _cell(image: Image.Image, row: int, column: int) -> Image.Image:
    left, top = column * CELL, LABEL + row * (LABEL + CELL) + LABEL
    return image.crop((left, top, left + CELL, top + CELL))


@pytest.mark.parametrize(
    ("k", "words"), [(2, ["A AA BA", "B AB BB"]), (3, ["AAA AAB ABB BBB"]), (4, ["AAAA AAAB AABB ABBB BBBB"])]
)
def test_sheet_of_weights_files_shows_each_word(k: int, words: list[str], tmp_path: Path) -> None:
    rows = [row.split() for row in words]
    assert rows_of_words(k) == rows
    spec, files = _spec(k), []
    thetas = {letter: initial_theta(spec, seed) for seed, letter in enumerate("AB")}
    for letter, theta in thetas.items():
        files.append(str(tmp_path / f"{letter}.safetensors"))
        Path(files[-1]).write_bytes(dump(Weights(spec, theta, "m"), "safetensors"))
    assert main(["compose", *files, "-o", str(tmp_path / "sheet.png"), "--n", str(N), "--seed", "3"]) == 0
    with Image.open(tmp_path / "sheet.png") as image:
        assert image.size == (len(rows[0]) * CELL, LABEL + len(rows) * (LABEL + CELL))
        for row, column in np.ndindex(len(rows), len(rows[0])):
            x = canonical_points(spec.domain, N, 3)
            word = [thetas[letter] for letter in rows[row][column]]
            frame = measure(spec.with_k(len(word)), np.stack(word))
            points = (compose(spec, word, x) - frame.center) * frame.factor()
            expected = draw(points, CELL)
            shown = np.asarray(_cell(image, row, column))
            assert (expected < 255).any()
            assert (shown == expected).mean() > 0.995, rows[row][column]  # a rounded point may fall a pixel further


def test_sheet_of_colored_weights_files_has_their_colors(tmp_path: Path) -> None:
    spec, color_spec = _spec(2), MappingSpec("color", 3, (4,), 3)
    files = []
    for name, level in (("a", (1, 0, 0)), ("b", (0, 0, 1))):
        weights = np.zeros(color_spec.size, np.float32)
        weights[-3:] = level  # the same color everywhere
        files.append(str(tmp_path / f"{name}.safetensors"))
        colored = Weights(spec, initial_theta(spec, ord(name)), "m", color=Color(color_spec, weights))
        Path(files[-1]).write_bytes(dump(colored, "safetensors"))
    sheets = [tmp_path / "sheet.png", tmp_path / "plain.png"]
    assert main(["compose", *files, "-o", str(sheets[0]), "--n", str(N)]) == 0
    assert main(["compose", *files, "-o", str(sheets[1]), "--n", str(N), "--color", "none"]) == 0
    with Image.open(sheets[0]) as image, Image.open(sheets[1]) as plain:
        means = {
            word: np.asarray(_cell(image, *at)).mean(axis=(0, 1)) - np.asarray(_cell(plain, *at)).mean(axis=(0, 1))
            for word, at in {"A": (0, 0), "B": (1, 0)}.items()
        }
    assert means["A"][0] > means["A"][2]
    assert means["B"][2] > means["B"][0]


def test_label_of_a_word_is_its_formula() -> None:
    assert [label(word, 2) for word in ("A", "AB", "BB")] == ["A(x)", "AB = A(B(x))", "BB = B(B(x)), the object B"]
    assert label("AABB", 4) == "AABB = A(A(B(B(x))))"


def test_sheet_names_cells_in_rows_of_any_length() -> None:
    point = np.zeros((1, 3), np.float32)
    image = sheet([[("one", point, None)], [("two", point, None), ("three", point, None)]], cell=100)
    assert image.size == (200, 2 * (LABEL + 100))
    ink = np.asarray(image).min(axis=2) < 255
    assert ink[:LABEL, :100].any()
    assert not ink[: LABEL + 100, 100:].any()
    assert ink[LABEL + 100 : 2 * LABEL + 100, 100:].any()
