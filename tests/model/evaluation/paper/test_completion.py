"""Experiment 12: completion by share seen, measured by its command on boxes and a tiny encoder of points."""

from pathlib import Path

import pytest
from PIL import Image

from model import cli
from model.evaluation.paper.completion import ALONE, CELL, COUNTS, EXPERIMENT, SHARES, cut, trial_name
from model.evaluation.paper.record import PaperRecord
from model.report.paper.page import record_path
from service.drawing.words import LABEL
from tests.support.small import data
from tests.support.small import model as tiny_model


def test_paper_points_measures_by_share_and_by_count(tmp_path: Path) -> None:
    folder = data.write(tmp_path / "data", train=1, test=2)
    model = tiny_model.build_points(tmp_path / "points.onnx")
    flags = ["--model", str(model), "--data", str(folder), "-o", str(tmp_path)]
    assert cli.main(["paper", "points", *flags]) == 0
    record = PaperRecord.read(record_path(tmp_path, EXPERIMENT))
    assert len(record.trials) == 3 * (len(SHARES) + len(COUNTS) - 1)
    whole, quarter = (record.trial(trial_name(ALONE, share, COUNTS[-1])).column("f@5%") for share in (1.0, 0.25))
    assert (whole > quarter).all()
    page = (tmp_path / "PAPER.md").read_text()
    assert "## Points of a part of an object" in page
    assert "25%, completed" in page
    assert "results/paper/points.png)" in page
    with Image.open(record_path(tmp_path, EXPERIMENT).with_suffix(".png")) as picture:
        assert picture.size == (3 * CELL, 2 * (CELL + LABEL))


def test_paper_points_of_an_encoder_of_images_fails(
    tmp_path: Path, model_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = data.write(tmp_path / "data", train=1, test=1)
    assert cli.main(["paper", "points", "--model", str(model_path), "--data", str(folder), "-o", str(tmp_path)]) == 2
    assert "takes images: name one of `hof-model train --trunk grid`" in capsys.readouterr().err


@pytest.mark.parametrize("share", SHARES)
def test_cut_keeps_a_share_of_the_surface(share: float) -> None:
    points = data.box(1)
    part = cut(points, share, len(points), seed=0)
    assert len(part) == pytest.approx(share * len(points), abs=2)
    assert len(cut(points, share, 64, seed=0)) == 64
