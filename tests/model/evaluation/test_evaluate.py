"""Evaluation of methods with predictable answers, along the path of an image."""

from pathlib import Path

import numpy as np
import pytest

from model import cli
from model.config import METHOD_DOMAINS, Method, TrainConfig
from model.evaluation.comparison import CEILING, ceiling_record, encoder_record, references
from model.evaluation.conditions import CONDITIONS
from model.evaluation.evaluate import cases, measure, measure_objects, predict
from model.evaluation.records import Record
from model.metrics import NAMES, compare
from model.training.state import RunState
from service.encoding.encoder import Encoder
from service.encoding.framing import Framing
from service.mapping.spec import MappingSpec
from tests.support.small import data as small_data
from tests.support.small import network as small_network

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return small_data.write(tmp_path_factory.mktemp("evaluate") / "data", train=4, test=3)


def test_measure_perfect_answer_scores_1_and_counts_are_prefixes(data: Path) -> None:
    objects = list(cases(data, "test"))
    whole, part = measure("one cloud", lambda _, n: objects[0].points[:n], objects, data, counts=(10_000, 1_000))
    assert (whole.n, part.n) == (10_000, 1_000)
    assert whole.column("f@1%")[0] == 1
    assert whole.column("cd_forward")[0] == 0
    assert part.column("cd_forward")[0] == 0 < part.column("cd_backward")[0]
    assert (whole.column("cd_forward")[1:] > 1).all()


def test_measure_four_views_returns_their_mean(data: Path) -> None:
    objects = list(cases(data, "test"))[:1]
    answers = iter([small_data.box(50), small_data.box(51), small_data.box(52), small_data.box(53)])
    evaluation = measure("four", lambda _, n: next(answers)[:n], objects, data)[0]
    expected = [compare(small_data.box(number), objects[0].points)["cd_sq"] for number in (50, 51, 52, 53)]
    assert evaluation.column("cd_sq") == pytest.approx([np.mean(expected)])


def test_measure_objects_in_threads_keeps_their_order(data: Path) -> None:
    objects = list(cases(data, "test"))
    evaluation = measure_objects("number", lambda case: dict.fromkeys(NAMES, float(case.entry.id[-2:])), objects)
    assert evaluation.column("f@1%").tolist() == [4, 5, 6]


def test_encoder_record_every_condition_has_its_evaluation(data: Path, model_path: Path) -> None:
    encoder = Encoder.open(model_path, 1)
    record = encoder_record(encoder, data, "test", 0, CONDITIONS, (500, 10_000))
    assert [(evaluation.condition, evaluation.n) for evaluation in record.evaluations] == [
        ("plain", 500),
        *((condition, 10_000) for condition in CONDITIONS),
    ]
    case = next(cases(data, "test"))
    views = [compare(predict(encoder, case.views[view]), case.points) for view in (1, 7, 13, 19)]
    for name in NAMES:
        assert record.evaluations[1].column(name)[0] == pytest.approx(np.mean([view[name] for view in views]))
    assert record.decoder is not None
    assert (record.decoder.parameters, record.decoder.layers) == (encoder.spec.size, 2)


def test_references_scores_are_in_the_necessary_order(data: Path) -> None:
    scores = {(one.method, one.condition): one.column("f@2%").mean() for one in references(data, "test", 0, CONDITIONS)}
    assert {condition for _, condition in scores} == set(CONDITIONS)
    best = [scores[name, "plain"] for name in ("sampling floor", "oracle nearest neighbor")]
    assert best == sorted(best, reverse=True)
    for other in ("image retrieval", "random training shape"):
        assert scores["oracle nearest neighbor", "plain"] >= scores[other, "plain"]


def test_ceiling_record_is_far_better_than_an_untrained_encoder(
    data: Path, model_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("model.evaluation.references.ceiling.STEPS", 150)
    encoder = Encoder.open(model_path, 1)
    fitted = ceiling_record(encoder, data, "test", 0).evaluations[0]
    guessed = encoder_record(encoder, data, "test", 0).evaluations[0]
    assert fitted.method == f"{CEILING} (tiny, k = 2)"
    assert (fitted.column("cd_sq") < 0.2 * guessed.column("cd_sq")).all()


@pytest.mark.parametrize(
    ("method", "parameters", "layers"),
    [
        ("hof", 16 * 3 + 16 + 3 * 16 + 3, 2),
        ("deepsdf", 1_578_241, 8),
        ("foldingnet", 1_056_775, 6),
        ("atlasnet_sphere", 1_719_067, 4),
    ],
)
def test_command_evaluate_run_writes_its_record(
    method: Method, parameters: int, layers: int, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spec = MappingSpec("small", 3, (16,), 3, k=2, domain=METHOD_DOMAINS.get(method, "cube"))
    small = small_network.ENCODER
    RunState(TrainConfig(spec=spec, method=method, encoder=small, framing=Framing(32), seed=5)).save(tmp_path, 0.0)
    command = ["evaluate", "--run", str(tmp_path), "--data", str(data), "--split", "test"]
    assert cli.main([*command, "-o", str(tmp_path / "rival.json")]) == 0
    assert "| rival |" in capsys.readouterr().out
    record = Record.read(tmp_path / "rival.json")
    assert record.decoder is not None
    assert (record.decoder.parameters, record.decoder.layers) == (parameters, layers)
    assert (record.origin["seed"], record.origin["training"]["config"]["method"]) == (5, method)
    assert record.ids == ("object04", "object05", "object06")
    assert np.isfinite(record.evaluations[0].column("cd_sq")).all()
