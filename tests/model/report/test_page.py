"""One report from a tiny encoder: the page, the raw metrics, the pictures, and another method's record."""

from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image

from model import cli
from model.evaluation.records import Record
from tests.support.small import data as small_data
from tests.support.small import model as tiny_model
from tests.support.small.trials import trials

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_data.write(tmp_path_factory.mktemp("report") / "data", train=3, test=2)


@pytest.fixture(scope="module")
def root(data: Path, model_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("root")
    other = ["evaluate", "--model", str(model_path), "--data", str(data), "--split", "test"]
    assert cli.main([*other, "-o", str(folder / "model/results/rival.json")]) == 0
    rival = Record.read(folder / "model/results/rival.json")
    renamed = replace(rival, method="rival", evaluations=tuple(replace(e, method="rival") for e in rival.evaluations))
    renamed.write(folder / "model/results/rival.json")
    spec = replace(tiny_model.SPEC, k=4)
    beside = tiny_model.build(folder / "k4.onnx", spec, meta=tiny_model.metadata(spec, "tiny-k4"))
    assert cli.main(["mixtures", "--model", str(model_path), "--data", str(data), "-o", str(folder)]) == 0
    trials(0.39, 50).write(folder / "model/results/surfaces.json")
    models = ["--model", str(model_path), "--model", str(beside)]
    assert cli.main(["results", *models, "--data", str(data), "-o", str(folder)]) == 0
    return folder


def test_results_page_holds_every_section(root: Path) -> None:
    page = (root / "RESULTS.md").read_text()
    for head in (
        "Targets",
        "Comparison",
        "Classes",
        "Points",
        "Surfaces",
        "Harder images",
        "Mixtures",
        "Other methods",
        "Pictures",
    ):
        assert head in page
    assert "| rival |" in page
    assert "## Color" not in page
    assert page.count("| tiny-k2 |") >= 6  # once compared, five conditions
    assert "test split, 2 objects" in page


def test_results_second_model_is_in_the_tables(root: Path) -> None:
    page = (root / "RESULTS.md").read_text()
    record = Record.read(root / "model/results/tiny-k4.json")
    assert (record.method, len(record.evaluations)) == ("tiny-k4", 1)
    assert "sha256 " + record.origin["digest"][:16] not in page  # the page's model is the first
    assert page.count("| tiny-k4 |") == 3  # compared, its differences, among the other methods
    assert f"| {record.origin['digest'][:16]} |" in page


def test_results_record_holds_the_raw_metrics(root: Path) -> None:
    record = Record.read(root / "model/results/tiny-k2.json")
    assert record.ids == ("object03", "object04")
    assert len(record.evaluations) == 5 + 2 + 5 + 6  # conditions, other counts; retrieval, other references
    assert len(record.origin["digest"]) == 64


def test_results_pictures_show_the_objects(root: Path) -> None:
    for name, objects in (("tiny-k2", 2), ("tiny-k2-everyday", 2)):
        with Image.open(root / f"model/results/{name}.png") as sheet:
            assert sheet.size == (2 * 3 * 160, -(-objects // 2) * 176)
            for column in range(6):
                cell = sheet.crop((column * 160, 16, (column + 1) * 160, 176))
                assert len(cell.getcolors(100_000) or []) > 1, (name, column)


def test_results_model_with_color_has_a_section_and_a_record(data: Path, colored_path: Path, tmp_path: Path) -> None:
    trials(0.39, 50).write(tmp_path / "model/results/surfaces.json")
    assert cli.main(["results", "--model", str(colored_path), "--data", str(data), "-o", str(tmp_path)]) == 0
    section = (tmp_path / "RESULTS.md").read_text().partition("## Color\n")[2].partition("\n## ")[0]
    methods = ["tiny-k2", "mean color of the object's pixels", "gray", "image retrieval", "true colors at the"]
    assert [section.index(f"| {method}") for method in methods] == sorted(section.index(f"| {m}") for m in methods)
    record = Record.read(tmp_path / "model/results/color/tiny-k2.json")
    errors = {evaluation.method: evaluation.column("color_forward") for evaluation in record.evaluations}
    assert (errors["true colors at the predicted points"] == 0).all()
    assert (errors["tiny-k2"] > 1).all()
    assert (errors["gray"] < 128).all()


def test_results_record_of_other_objects_is_refused(
    root: Path, data: Path, model_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "model/results"
    rival = Record.read(root / "model/results/rival.json")
    replace(rival, ids=("object03",)).write(folder / "rival.json")
    assert cli.main(["results", "--model", str(model_path), "--data", str(data), "-o", str(tmp_path)]) == 2
    assert "is of other objects" in capsys.readouterr().err
    assert not (tmp_path / "RESULTS.md").exists()
