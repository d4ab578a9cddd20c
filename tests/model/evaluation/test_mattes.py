"""Mattes in front of photographs: the pictures, the ways that are compared, and the section of RESULTS.md."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from model.evaluation.locations import MATTES
from model.evaluation.mattes import (
    SCORES,
    SIDE,
    TRUE_MASKS,
    WHOLE_PICTURE,
    ZOOMS,
    MatteTrials,
    measure_mattes,
    overlap_of,
    picture_of,
)
from model.report.mattes import section
from service.encoding.encoder import Encoder
from service.encoding.masks import Matte
from tests.support.small import data as small_data


def _all(image: Image.Image) -> Matte:
    return np.full(image.size[::-1], 255, np.uint8)


def _nothing(image: Image.Image) -> Matte:
    return np.zeros(image.size[::-1], np.uint8)


@pytest.fixture(scope="module")
def trials(tmp_path_factory: pytest.TempPathFactory, model_path: Path) -> MatteTrials:
    data = small_data.write(tmp_path_factory.mktemp("mattes") / "data", train=1, test=2)
    ways = {"all": _all, "nothing": _nothing}
    return measure_mattes(Encoder.open(model_path, 1), ways, data, "test", 0)


@pytest.mark.parametrize("zoom", ZOOMS)
def test_picture_has_the_object_at_its_share_of_the_side(zoom: float) -> None:
    view = np.zeros((64, 64, 4), np.uint8)
    view[10:50, 20:40] = (255, 0, 0, 255)
    picture, matte = picture_of(view, zoom, np.random.default_rng(0))
    assert (picture.shape, matte.shape) == ((SIDE, SIDE, 3), (SIDE, SIDE))
    rows, columns = np.flatnonzero((matte > 127).any(axis=1)), np.flatnonzero((matte > 127).any(axis=0))
    assert rows[-1] + 1 - rows[0] == pytest.approx(zoom * SIDE, abs=2)
    assert columns[-1] + 1 - columns[0] == pytest.approx(zoom * SIDE / 2, abs=2)
    assert (picture[matte == 255] == (255, 0, 0)).all()


def test_overlap_of_mattes_counts_pixels() -> None:
    one, other = np.zeros((2, 10, 10), np.uint8)
    assert overlap_of(one, other) == 1
    one[:, :6], other[:, 3:9] = 200, 200
    assert overlap_of(one, other) == pytest.approx(1 / 3, abs=0.01)


def test_measure_mattes_covers_all_ways_and_keeps_refused_pictures(trials: MatteTrials) -> None:
    ways = [WHOLE_PICTURE, "all", "nothing", TRUE_MASKS]
    assert [(each.way, each.zoom) for each in trials.outcomes] == [(way, zoom) for zoom in ZOOMS for way in ways]
    for each in trials.outcomes:
        assert all(len(each.scores[name]) == 8 for name in SCORES)
        assert len(each.overlaps) == (8 if each.way in ("all", "nothing") else 0)
        assert each.refused == (8 if each.way == "nothing" else 0)
    whole, _, nothing, true = trials.outcomes[:4]
    assert nothing.scores == whole.scores
    assert true.scores != whole.scores


def test_section_has_a_row_for_each_way_and_is_empty_without_a_record(trials: MatteTrials, tmp_path: Path) -> None:
    assert section(tmp_path) == ""
    trials.write(tmp_path / MATTES)
    assert MatteTrials.read(tmp_path / MATTES) == trials
    rows = [line for line in section(tmp_path).splitlines() if line.startswith("| 0.")]
    assert len(rows) == len(trials.outcomes)
    assert rows[3].endswith("| 0.0% |")
    assert "| 8 |" in rows[2]
