"""Mixtures of two objects: which pairs, what is measured of them, and what the page says of it."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from model import cli
from model.data.manifest import Entry
from model.evaluation.classes import class_of
from model.evaluation.conditions import png
from model.evaluation.evaluate import cases
from model.evaluation.mixtures import AVERAGE, Mixtures, draw_pairs, mixed_words
from model.metrics import nearest_distances
from model.report.mixtures import section, verdict
from service.encoding.encoder import Encoder
from service.encoding.framing import preprocess
from service.mapping.sampler import Sampler
from service.mapping.spec import Array, MappingSpec
from tests.support.small import data as small_data
from tests.support.small import model as tiny_model

pytestmark = pytest.mark.slow

POINTS = 2_000
TRAIN, TEST = 3, 4
SPEC_K4 = MappingSpec("tiny", 3, (16,), 3, k=4, domain="sphere")


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_data.write(tmp_path_factory.mktemp("mixtures") / "data", TRAIN, TEST)


@pytest.fixture(scope="module")
def root(data: Path, model_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the mixtures of two models."""
    folder = tmp_path_factory.mktemp("root")
    other = tiny_model.build(folder / "k4.onnx", SPEC_K4, meta=tiny_model.metadata(SPEC_K4, "tiny-k4"))
    for model in (model_path, other):
        assert cli.main(["mixtures", "--model", str(model), "--data", str(data), "-o", str(folder)]) == 0
    return folder


@pytest.fixture
def mixtures(root: Path) -> Mixtures:
    return Mixtures.read(root / "model/results/mixtures/tiny-k2.json")


def _entry(number: int, name: str) -> Entry:
    return Entry(f"{number}", name, "s", "Living room", "", "CC0", "", "", "test")


def test_draw_pairs_enough_of_a_class_halves_them_and_repeats_none() -> None:
    entries = [_entry(number, ("Chair", "Sofa", "Vase")[number % 3]) for number in range(60)]
    pairs = draw_pairs(entries, seed=0)
    assert len(pairs) == len({frozenset(pair[:2]) for pair in pairs}) == 200
    labels = [class_of(entry) for entry in entries]
    assert [same for *_, same in pairs] == [True] * 100 + [False] * 100
    assert all((labels[a] == labels[b]) is same for a, b, same in pairs)
    assert {labels[a] for a, _, same in pairs if same} == {"chair", "sofa"}  # a vase is of no class
    assert draw_pairs(entries, seed=0) == pairs != draw_pairs(entries, seed=1)
    assert 60 < sum(a < b for a, b, _ in pairs) < 140


def test_draw_pairs_few_of_a_class_fills_up_across_classes() -> None:
    entries = [_entry(number, "Chair" if number < 3 else "Vase") for number in range(100)]
    same = [pair[2] for pair in draw_pairs(entries, seed=0)]
    assert (same.count(True), same.count(False)) == (3, 197)


@pytest.mark.parametrize(
    ("k", "words"), [(2, ["AB", "BA"]), (3, ["AAB", "ABB", "BAA"]), (4, ["AAAB", "AABB", "ABBB", "BBAA"])]
)
def test_mixed_words_k_returns_gradient_and_even_words(k: int, words: list[str]) -> None:
    assert mixed_words(k) == words


def _distance(a: Array, b: Array) -> float:
    return 100 * float(nearest_distances(a, b).mean() + nearest_distances(b, a).mean())


def test_measure_figures_are_distances_of_the_clouds_that_the_model_draws(
    mixtures: Mixtures, data: Path, model_path: Path
) -> None:
    encoder, objects = Encoder.open(model_path, 1), {case.entry.id: case for case in cases(data, "test")}
    training = [case.points[:POINTS] for case in cases(data, "train")]
    assert len(mixtures.pairs) == TEST * (TEST - 1) // 2
    for index, (id_a, id_b, _) in enumerate(mixtures.pairs):
        a, b = (
            encoder.encode(preprocess(png(objects[id_].views[1]), encoder.framing).tensor)[0].theta
            for id_ in (id_a, id_b)
        )
        mean: Array = ((a + b) / 2).astype(np.float32)
        words: dict[str, tuple[Array, Array]] = {"A": (a, a), "B": (b, b), "AB": (a, b), "BA": (b, a)}
        words[AVERAGE] = (mean, mean)
        assert mixtures.figures.keys() == words.keys()
        for name, word in words.items():
            cloud = Sampler(encoder.spec, word).points(POINTS)
            expected = {
                "nearest": min(_distance(cloud, other) for other in training),
                "to_a": _distance(cloud, Sampler(encoder.spec, (a, a)).points(POINTS, seed=1)),
                "to_b": _distance(cloud, Sampler(encoder.spec, (b, b)).points(POINTS, seed=1)),
            }
            for figure, distance in expected.items():
                assert mixtures.figures[name][figure][index] == pytest.approx(distance, abs=1e-3), (name, figure)


def test_command_mixtures_k_of_4_draws_its_gradient(root: Path) -> None:
    mixtures = Mixtures.read(root / "model/results/mixtures/tiny-k4.json")
    assert mixtures.figures.keys() == {"A", "B", "AAAB", "AABB", "ABBB", "BBAA", AVERAGE}
    for name, columns in (("tiny-k2", 3 + 3 + 1), ("tiny-k4", 5 + 1)):
        with Image.open(root / f"model/results/mixtures/{name}.png") as picture:
            assert picture.width == columns * 180
            assert picture.height % (180 + 28) == 0
            ink = np.asarray(picture.convert("L")) < 255
            assert all(ink[28:208, 180 * column : 180 * (column + 1)].any() for column in range(columns))


def test_section_two_models_have_their_tables_and_verdicts(root: Path, tmp_path: Path) -> None:
    page = section(root)
    assert page.startswith("## Mixtures\n")
    for head in ("### tiny-k2, k = 2", "### tiny-k4, k = 4", "| AABB |", "| average |", "| the object A |"):
        assert head in page
    assert page.count("**Averaging") + page.count("**Whether averaging") == 2
    assert section(tmp_path) == ""


def _shifted(mixtures: Mixtures, nearest_by: float, parents_by: float) -> Mixtures:
    """Copy with averages that lie farther than the words by these distances."""
    words = {figure: mixtures.words(figure) for figure in ("nearest", "to_a", "to_b")}
    by = {"nearest": nearest_by, "to_a": parents_by, "to_b": parents_by}
    average = {figure: values + by[figure] for figure, values in words.items()}
    return replace(mixtures, figures={**mixtures.figures, AVERAGE: average})


def test_verdict_shifted_figures_changes_with_them(mixtures: Mixtures) -> None:
    yes, no = verdict(_shifted(mixtures, 1, -1)), verdict(_shifted(mixtures, -1, 1))
    assert yes.startswith("**Averaging gives blobs here, as the paper says**")
    assert "(+1.000 (+1.000 to +1.000))" in yes
    assert "they lie nearer than" in yes
    assert no.startswith("**Averaging gives no blobs here, unlike in the paper**")
    assert "they lie farther than" in no
    assert verdict(_shifted(mixtures, 0, 0)).startswith("**Whether averaging gives blobs remains open**")


def test_copies_mixture_as_near_to_a_parent_as_its_own_sample_is_a_copy(mixtures: Mixtures) -> None:
    a, b = mixtures.figures["A"], mixtures.figures["B"]
    between = {"nearest": a["nearest"], "to_a": 1.6 * a["to_a"], "to_b": 1.6 * b["to_b"]}
    for other, expected in (({}, False), ({"to_a": 1.4 * a["to_a"]}, True), ({"to_b": 1.4 * b["to_b"]}, True)):
        mixture = replace(mixtures, figures={**mixtures.figures, "AB": {**between, **other}})
        assert (mixture.copies("AB") == expected).all()


def test_command_mixtures_k_of_1_or_one_object_is_refused(
    data: Path, model_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = MappingSpec("tiny", 3, (16,), 3)
    single = tiny_model.build(tmp_path / "k1.onnx", spec, meta=tiny_model.metadata(spec, "tiny-k1"))
    for model, split in ((single, "test"), (model_path, "val")):
        command = ["mixtures", "--model", str(model), "--data", str(data), "--split", split, "-o", str(tmp_path)]
        assert cli.main(command) == 2
        assert "k of 2 or more and two objects" in capsys.readouterr().err
    assert not (tmp_path / "model").exists()


@pytest.mark.parametrize("text", ["{}", "[]", "not JSON", '{"pairs": [], "figures": {"A": {}}}'])
def test_mixtures_other_file_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "x.json").write_text(text)
    with pytest.raises(ValueError, match="holds no mixtures"):
        Mixtures.read(tmp_path / "x.json")
