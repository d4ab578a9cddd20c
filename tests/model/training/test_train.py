"""One tiny run, from meshes to an exported encoder: training, resuming, export, evaluation, report."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model import cli
from model.config import EncoderConfig, TrainConfig
from model.data.build import build
from model.data.dataset import draw_batch, load_examples
from model.data.sources.meshes import folder_records
from model.evaluation.compared import COMPARED
from model.evaluation.evaluate import predict
from model.evaluation.records import Record
from model.export import parity
from model.networks.decoders import make_network
from model.training.checkpoints import chosen_checkpoint, load_encoder, load_network, predictor
from model.training.losses import chamfer
from model.training.train import _sizes, _State, _step, train
from service.encoding.encoder import Encoder
from service.errors import InvalidModel
from tests.support.small import model as tiny_model
from tests.support.small import network as small_network
from tests.support.small.shapes import write_folder

CONFIG = replace(small_network.CONFIG, points=128, target_points=200, learning_rate=3e-3, minutes=0.1)


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("training")
    build(folder_records(write_folder(folder / "meshes"), "CC0"), folder / "data", seed=0, processes=2)
    return folder / "data"


@pytest.fixture(scope="session")
def run(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    points = make_network(CONFIG)(torch.zeros(2, 3, 32, 32), torch.zeros(2, 5, 3))  # compiled before the clock runs
    chamfer(points, torch.zeros(2, 5, 3)).backward()  # type: ignore[no-untyped-call]
    return train(data, tmp_path_factory.mktemp("run"), CONFIG).parent


@pytest.fixture(scope="session")
def exported(run: Path, data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("weights") / "small-k2.onnx"
    assert cli.main(["export", "--run", str(run), "--data", str(data), "-o", str(output)]) == 0
    return output


def records(run: Path) -> list[dict[str, float]]:
    return [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]


def test_training_lowers_the_loss(data: Path) -> None:
    examples = load_examples(data, "train", CONFIG.framing, variants=False)
    state = _State(CONFIG)
    with ThreadPoolExecutor(2) as threads:
        losses = [_step(state, draw_batch(examples, CONFIG, step), 0.1, threads) for step in range(150)]
    assert np.mean(losses[-10:]) < 0.5 * np.mean(losses[:10])


def test_a_run_keeps_its_config(run: Path) -> None:
    _, config, state = load_encoder(run / "last.pt")
    assert config == CONFIG
    assert state["step"] == records(run)[-1]["step"]


def test_a_resumed_run_goes_on_where_it_stopped(
    run: Path, data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved = torch.load(run / "last.pt", weights_only=True)
    saved["config"]["minutes"] = 0.15
    torch.save(saved, tmp_path / "last.pt")
    lines = (run / "log.jsonl").read_text()
    (tmp_path / "log.jsonl").write_text(lines + json.dumps({"step": 10**9}) + '\n{"step": 1')  # killed later, and here
    train(data, tmp_path, TrainConfig(seed=99))  # the stored config counts, not this one
    assert "with the options that it was begun with" in capsys.readouterr().out
    _, config, state = load_encoder(tmp_path / "last.pt")
    assert config.seed == CONFIG.seed
    assert state["step"] > saved["step"]
    assert state["elapsed_s"] >= 9
    steps = [record["step"] for record in records(tmp_path)]
    assert steps == sorted(steps)
    assert steps[: len(records(run))] == [record["step"] for record in records(run)]
    assert saved["step"] < steps[-1] < 10**9


def test_a_resumed_run_makes_the_same_step(data: Path, tmp_path: Path) -> None:
    examples = load_examples(data, "train", CONFIG.framing, variants=False)
    torch.manual_seed(0)
    state = _State.begin(CONFIG)
    with ThreadPoolExecutor(1) as threads:
        for _ in range(3):
            _step(state, draw_batch(examples, CONFIG, state.step), 0.3, threads)
        state.save(tmp_path, score=0.5)
        resumed = _State.resume(tmp_path, CONFIG)
        losses = [_step(each, draw_batch(examples, CONFIG, each.step), 0.3, threads) for each in (state, resumed)]
    assert losses[0] == losses[1]
    assert (resumed.step, resumed.best) == (4, 0.5)
    for ours, theirs in ((state.network, resumed.network), (state.average, resumed.average)):
        for name, value in ours.state_dict().items():
            assert torch.equal(value, theirs.state_dict()[name]), name
    assert not torch.equal(*(each.encoder.head.linear.weight for each in (state.network, state.average)))  # type: ignore[union-attr, arg-type]


def test_the_best_checkpoint_is_chosen_and_the_average_loaded(run: Path, tmp_path: Path) -> None:
    validated = [record for record in records(run) if "f@1%" in record]
    assert all(0 <= record["f@1%"] <= record["f@2%"] <= 1 and record["val"] > 0 for record in validated)
    assert chosen_checkpoint(run) == run / "best.pt"
    saved = torch.load(run / "best.pt", weights_only=True)
    assert saved["best"] == max(record["f@1%"] + record["f@2%"] for record in validated)
    encoder, _, _ = load_encoder(run / "best.pt")
    assert torch.equal(encoder.head.linear.weight, saved["average"]["encoder.head.linear.weight"])
    assert chosen_checkpoint(tmp_path) == tmp_path / "last.pt"


def test_a_worse_checkpoint_does_not_become_the_best(tmp_path: Path) -> None:
    state = _State(CONFIG)
    for step, score in ((1, 0.3), (2, 0.2), (3, 0.4), (4, 0.1)):
        state.step = step
        state.save(tmp_path, score)
    assert torch.load(tmp_path / "best.pt", weights_only=True)["step"] == 3
    assert torch.load(tmp_path / "last.pt", weights_only=True)["step"] == 4


def test_a_run_starts_from_a_checkpoint_and_counts_its_steps(run: Path, data: Path, tmp_path: Path) -> None:
    old = run / "last.pt"
    encoder, config, before = load_encoder(old)
    assert config == CONFIG
    again = replace(CONFIG, start=str(old), learning_rate=0.0, weight_decay=0.0, minutes=0.02)
    started, config, state = load_encoder(train(data, tmp_path / "run", again))
    assert config.start == str(old)
    assert state["step"] == before["step"] + records(tmp_path / "run")[-1]["step"]
    assert state["elapsed_s"] > before["elapsed_s"]
    assert torch.equal(started.head.linear.weight, encoder.head.linear.weight)  # nothing was learnt


def test_a_blend_of_two_runs_lies_between_them(run: Path, data: Path, tmp_path: Path) -> None:
    later = train(data, tmp_path / "later", replace(CONFIG, start=str(run / "last.pt"), minutes=0.03)).parent
    asked = ["blend", str(run), str(later), "--share", "0.25", "-o", str(tmp_path / "both")]
    assert cli.main(asked) == 0
    first, second, both = (load_network(chosen_checkpoint(folder)) for folder in (run, later, tmp_path / "both"))
    assert both[1:] == second[1:]
    for name, weight in both[0].state_dict().items():
        if weight.is_floating_point():
            between = 0.75 * first[0].state_dict()[name] + 0.25 * second[0].state_dict()[name]
            torch.testing.assert_close(weight, between, msg=name)


def test_an_exported_model_is_blended_too(run: Path, exported: Path, tmp_path: Path) -> None:
    assert cli.main(["blend", str(exported), str(run), "--share", "0", "-o", str(tmp_path)]) == 0
    blended, weights = (dict(load_network(file)[0].named_parameters()) for file in (tmp_path / "best.pt", exported))
    assert all(torch.equal(weight, weights[name]) for name, weight in blended.items())


def test_runs_of_different_networks_are_not_blended(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = _State.begin(replace(CONFIG, spec=CONFIG.spec.with_k(1)))
    other.save(tmp_path, score=0)
    for asked, what in (
        ([str(tmp_path)], "differ in their spec"),
        ([str(run), "--share", "1.5"], "share is 1.5"),
        ([str(tmp_path / "none")], "No such file"),
    ):
        assert cli.main(["blend", str(run), *asked, "-o", str(tmp_path / "both")]) == 2
        assert what in capsys.readouterr().err
    assert not (tmp_path / "both").exists()


def test_an_exported_encoder_is_a_checkpoint(run: Path, exported: Path, tmp_path: Path) -> None:
    encoder, config, before = load_encoder(chosen_checkpoint(run))
    again, same, state = load_encoder(exported)
    assert same == config
    assert state["step"] == before["step"]
    assert state["elapsed_s"] == pytest.approx(before["elapsed_s"], abs=3)  # the card has tenths of minutes
    for name, value in encoder.state_dict().items():
        if not name.endswith("num_batches_tracked"):
            rounded = value.half().float() if value.dim() > 1 else value
            assert torch.equal(again.state_dict()[name], rounded), name
    started = _State.begin(replace(CONFIG, start=str(exported)))
    assert torch.equal(started.network.state_dict()["encoder.head.linear.weight"], again.head.linear.weight)
    (tmp_path / "other.onnx").write_bytes(b"no ONNX")
    with pytest.raises(InvalidModel, match="unusable"):
        load_network(tmp_path / "other.onnx")
    with pytest.raises(ValueError, match="does not tell how it was trained"):
        load_network(tiny_model.build(tmp_path / "tiny.onnx"))


def test_a_start_of_another_kind_is_refused(run: Path, data: Path, tmp_path: Path) -> None:
    spec, lite0 = CONFIG.spec.with_k(1), replace(CONFIG.encoder, trunk="lite0")
    for what, change in {
        "rank": {"encoder": EncoderConfig(rank=4)},
        "method": {"method": "direct"},
        "trunk and another spec": {"encoder": lite0, "spec": spec},
    }.items():
        other = replace(CONFIG, start=str(run / "last.pt"), **change)  # type: ignore[arg-type]
        with pytest.raises(ValueError, match=f"another {what}"):
            train(data, tmp_path / "run", other)
    (tmp_path / "photo.pt").write_bytes(b"no checkpoint")
    torch.save({"config": CONFIG.to_dict()}, tmp_path / "part.pt")
    for name in ("photo.pt", "part.pt"):
        with pytest.raises(ValueError, match=f"{name} is no checkpoint of `hof-model train`"):
            train(data, tmp_path / "run", replace(CONFIG, start=str(tmp_path / name)))
    for budget in ({"minutes": 0}, {"steps": 0}, {"minutes": 1, "steps": -1}):
        with pytest.raises(ValueError, match="must be above 0"):
            train(data, tmp_path / "new", replace(CONFIG, **budget))  # type: ignore[arg-type]
    assert not (tmp_path / "new").exists()


def test_a_run_of_another_spec_starts_from_the_trunk(run: Path) -> None:
    started = _State.begin(replace(CONFIG, spec=CONFIG.spec.with_k(1), start=str(run / "last.pt"))).network.state_dict()
    for name, value in load_network(run / "last.pt")[0].state_dict().items():
        assert torch.equal(started[name], value) != (".head.linear." in name), name


@pytest.mark.parametrize("method", ["hof", "deepsdf", "foldingnet", "direct"])
def test_every_method_trains_with_the_late_loss_and_predicts(method: str, data: Path, tmp_path: Path) -> None:
    domain = "cube" if method == "foldingnet" else "ball"
    config = replace(CONFIG, method=method, spec=replace(CONFIG.spec, domain=domain), minutes=0.02, late_from=0.0)  # type: ignore[arg-type]
    checkpoint = train(data, tmp_path, replace(config, late_points=64, late_target_points=80))
    assert records(tmp_path)[-1]["step"] > 0
    predict = predictor(*load_network(checkpoint)[:2])
    images = np.random.default_rng(0).random((2, 3, 32, 32), np.float32)
    points = predict(images, 12_000, 7)
    assert points.shape == (2, 12_000, 3)
    assert points.dtype == np.float32
    assert np.isfinite(points).all()
    assert predict(images[1:], 500, 7)[0] == pytest.approx(points[1, :500], abs=1e-5)
    different = len(np.unique(points[0], axis=0))
    assert different == 1_024 if method == "direct" else different > 10_000
    if method == "hof":
        assert load_encoder(checkpoint)[0].head
    else:
        with pytest.raises(ValueError, match="only hof"):
            load_encoder(checkpoint)


def test_batches_grow_late() -> None:
    config = replace(CONFIG, late_from=0.6, late_points=300, late_target_points=500)
    assert _sizes(config, 0.59) == config
    assert (_sizes(config, 0.6).points, _sizes(config, 0.6).target_points) == (300, 500)
    assert _sizes(CONFIG, 0.999) == CONFIG  # by default, never


def test_a_finished_run_is_left_alone(run: Path, data: Path) -> None:
    before = (run / "last.pt").read_bytes()
    train(data, run, CONFIG)
    assert (run / "last.pt").read_bytes() == before


def test_the_exported_file_describes_itself(exported: Path) -> None:
    encoder = Encoder.open(exported, 1)
    assert (encoder.name, encoder.spec, encoder.framing) == ("small-k2", CONFIG.spec, CONFIG.framing)
    assert encoder.card["training"]["steps"] > 0
    assert set(encoder.card["figures"]) > {"small-k2", "mean shape", "image retrieval", "oracle nearest neighbour"}
    page = exported.with_suffix(".md").read_text()
    assert "image retrieval" in page
    assert f"{exported.stat().st_size:,} bytes" in page


def test_matrices_are_stored_in_half_the_bytes(exported: Path, run: Path) -> None:
    encoder, config, _ = load_encoder(run / "last.pt")
    numbers = sum(p.numel() for p in encoder.parameters() if p.dim() > 1)
    assert exported.stat().st_size < 2.2 * numbers + 20_000 + 16 * config.spec.size
    assert max(parity(encoder, config, Encoder.open(exported, 1)).values()) > 0  # unrounded weights do differ


def test_a_prediction_is_what_the_service_would_answer(exported: Path) -> None:
    encoder = Encoder.open(exported, 1)
    view = np.zeros((64, 64, 4), np.uint8)
    view[20:40, 10:50] = [10, 200, 30, 255]
    points = predict(encoder, view, 500)
    assert points.shape == (500, 3)
    moved = np.roll(view, (5, 3), axis=(0, 1))
    assert predict(encoder, moved, 500) == pytest.approx(points)  # framing undoes a shift


def test_a_compared_method_takes_its_steps_and_enters_the_tables(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # runs go below the working folder
    monkeypatch.setitem(COMPARED, "small", replace(CONFIG, method="direct"))
    assert cli.main(["retrain", "small", "--steps", "3", "--data", str(data), "-o", str(tmp_path)]) == 0
    record = Record.read(tmp_path / "small.json")
    assert (record.method, record.made["training"]["steps"]) == ("small, 3 steps", 3)
