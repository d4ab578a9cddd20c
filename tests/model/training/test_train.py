"""The training loop: it learns, ends with its budget, and resumes where it stopped."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model.config import METHOD_DOMAINS, Method, TrainConfig
from model.data.dataset import draw_batch, load_examples
from model.training.checkpoints import load_encoder, load_network, predictor
from model.training.state import RunState
from model.training.train import train, train_step
from tests.support.small.runs import RUN, records

pytestmark = pytest.mark.slow


def test_train_step_repeated_lowers_the_loss(built: Path) -> None:
    examples = load_examples(built, "train", RUN.framing, variants=False)
    state = RunState(RUN)
    with ThreadPoolExecutor(2) as threads:
        losses = [train_step(state, draw_batch(examples, RUN, step), 0.1, threads) for step in range(150)]
    assert np.mean(losses[-10:]) < 0.5 * np.mean(losses[:10])


def test_train_stores_its_config_and_its_last_step(run: Path) -> None:
    _, config, spent = load_encoder(run / "last.pt")
    assert config == RUN
    assert spent["step"] == records(run)[-1]["step"] == RUN.steps


def test_train_of_a_stopped_run_resumes_where_it_stopped(
    run: Path, built: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved = torch.load(run / "last.pt", weights_only=True)
    saved["config"]["steps"] = 150
    torch.save(saved, tmp_path / "last.pt")
    lines = (run / "log.jsonl").read_text()
    (tmp_path / "log.jsonl").write_text(lines + json.dumps({"step": 10**9}) + '\n{"step": 1')  # killed later, and here
    train(built, tmp_path, TrainConfig(seed=99))  # the stored config counts, not this one
    assert "with the options that it was started with" in capsys.readouterr().out
    _, config, spent = load_encoder(tmp_path / "last.pt")
    assert config.seed == RUN.seed
    assert spent["step"] == 150
    assert spent["elapsed_s"] > saved["elapsed_s"]
    steps = [record["step"] for record in records(tmp_path)]
    assert steps == sorted(steps)
    assert steps[: len(records(run))] == [record["step"] for record in records(run)]
    assert saved["step"] < steps[-1] < 10**9


def test_train_step_of_a_resumed_run_is_the_same(built: Path, tmp_path: Path) -> None:
    examples = load_examples(built, "train", RUN.framing, variants=False)
    torch.manual_seed(0)
    state = RunState.begin(RUN)
    with ThreadPoolExecutor(1) as threads:
        for _ in range(3):
            train_step(state, draw_batch(examples, RUN, state.step), 0.3, threads)
        state.save(tmp_path, score=0.5)
        resumed = RunState.resume(tmp_path, RUN)
        losses = [train_step(each, draw_batch(examples, RUN, each.step), 0.3, threads) for each in (state, resumed)]
    assert losses[0] == losses[1]
    assert (resumed.step, resumed.best) == (4, 0.5)
    for ours, theirs in ((state.network, resumed.network), (state.average, resumed.average)):
        for name, value in ours.state_dict().items():
            assert torch.equal(value, theirs.state_dict()[name]), name
    assert not torch.equal(*(each.encoder.head.linear.weight for each in (state.network, state.average)))  # type: ignore[union-attr, arg-type]


def test_train_by_minutes_ends_after_its_budget(built: Path, tmp_path: Path) -> None:
    train(built, tmp_path, replace(RUN, steps=None, minutes=1e-6))  # shorter than any step
    assert records(tmp_path)[-1]["step"] == 1


def test_progress_is_the_share_of_the_budget() -> None:
    state = RunState(replace(RUN, steps=None, minutes=2.0))
    state.step, state.elapsed_s = 50, 30.0
    assert state.progress == 0.25
    state.config = replace(RUN, steps=200)
    assert state.progress == 0.25


@pytest.mark.parametrize("budget", [{"steps": None, "minutes": 0}, {"steps": 0}, {"minutes": 1, "steps": -1}])
def test_train_without_a_budget_is_refused(budget: dict[str, int], built: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="must be above 0"):
        train(built, tmp_path / "new", replace(RUN, **budget))  # type: ignore[arg-type]
    assert not (tmp_path / "new").exists()


def test_train_of_a_finished_run_changes_nothing(run: Path, built: Path) -> None:
    before = (run / "last.pt").read_bytes()
    train(built, run, RUN)
    assert (run / "last.pt").read_bytes() == before


@pytest.mark.parametrize("method", ["hof", "deepsdf", "foldingnet", "direct", "atlasnet_sphere"])
def test_train_with_the_late_loss_gives_a_predictor_of_every_method(
    method: Method, built: Path, tmp_path: Path
) -> None:
    domain = METHOD_DOMAINS.get(method, "ball")
    config = replace(RUN, method=method, spec=replace(RUN.spec, domain=domain), steps=3, late_from=0.0)
    checkpoint = train(built, tmp_path, replace(config, late_points=64, late_target_points=80))
    assert records(tmp_path)[-1]["step"] == 3
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


def test_config_at_a_late_progress_has_more_points() -> None:
    config = replace(RUN, late_from=0.6, late_points=300, late_target_points=500)
    assert config.at(0.59) == config
    assert (config.at(0.6).points, config.at(0.6).target_points) == (300, 500)
    assert RUN.at(0.999) == RUN  # by default, never
