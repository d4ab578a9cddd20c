"""Means of weights: the moving average over a run, and the blend of two runs."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import nn

from model import cli
from model.training.average import EMA_DECAY, update_average
from model.training.checkpoints import chosen_checkpoint, load_network
from model.training.state import RunState
from model.training.train import train
from tests.support.small.runs import RUN

pytestmark = pytest.mark.slow


def test_update_average_moves_by_the_decay_of_its_step() -> None:
    average, network = nn.Linear(1, 1, bias=False), nn.Linear(1, 1, bias=False)
    nn.init.zeros_(average.weight)
    nn.init.ones_(network.weight)
    update_average(average, network, step=0)
    assert float(average.weight.detach()) == pytest.approx(0.9)  # decay 1 / 10
    update_average(average, network, step=9)
    assert float(average.weight.detach()) == pytest.approx(1 - 0.1 * 10 / 19)
    nn.init.zeros_(average.weight)
    update_average(average, network, step=10**6)
    assert float(average.weight.detach()) == pytest.approx(1 - EMA_DECAY)


def test_update_average_includes_the_statistics_of_batch_norm() -> None:
    average, network = nn.BatchNorm1d(1), nn.BatchNorm1d(1)
    network(torch.tensor([[0.0], [20.0]]))  # momentum 0.1: the running mean becomes 1
    update_average(average, network, step=0)
    assert average.running_mean is not None
    assert float(average.running_mean) == pytest.approx(0.9)
    assert average.num_batches_tracked is not None
    assert int(average.num_batches_tracked) == 1


def test_blend_of_two_runs_lies_between_them(run: Path, built: Path, tmp_path: Path) -> None:
    later = train(built, tmp_path / "later", replace(RUN, start=str(run / "last.pt"), steps=3)).parent
    command = ["blend", str(run), str(later), "--share", "0.25", "-o", str(tmp_path / "both")]
    assert cli.main(command) == 0
    first, second, both = (load_network(chosen_checkpoint(folder)) for folder in (run, later, tmp_path / "both"))
    assert both[1:] == second[1:]
    for name, weight in both[0].state_dict().items():
        if weight.is_floating_point():
            between = 0.75 * first[0].state_dict()[name] + 0.25 * second[0].state_dict()[name]
            torch.testing.assert_close(weight, between, msg=name)


def test_blend_with_an_exported_model_takes_its_weights(run: Path, exported: Path, tmp_path: Path) -> None:
    assert cli.main(["blend", str(exported), str(run), "--share", "0", "-o", str(tmp_path)]) == 0
    blended, weights = (dict(load_network(file)[0].named_parameters()) for file in (tmp_path / "best.pt", exported))
    assert all(torch.equal(weight, weights[name]) for name, weight in blended.items())


def test_blend_of_different_networks_is_refused(run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = RunState.begin(replace(RUN, spec=RUN.spec.with_k(1)))
    other.save(tmp_path, score=0)
    for options, problem in (
        ([str(tmp_path)], "differ in their spec"),
        ([str(run), "--share", "1.5"], "share is 1.5"),
        ([str(tmp_path / "none")], "No such file"),
    ):
        assert cli.main(["blend", str(run), *options, "-o", str(tmp_path / "both")]) == 2
        assert problem in capsys.readouterr().err
    assert not (tmp_path / "both").exists()
