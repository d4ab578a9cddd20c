"""The moving average of weights."""

import pytest
import torch
from torch import nn

from model.training.average import EMA_DECAY, update_average


def test_the_average_moves_by_the_decay_of_its_step() -> None:
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


def test_the_statistics_of_batch_norm_are_averaged_too() -> None:
    average, network = nn.BatchNorm1d(1), nn.BatchNorm1d(1)
    network(torch.tensor([[0.0], [20.0]]))  # momentum 0.1: the running mean becomes 1
    update_average(average, network, step=0)
    assert average.running_mean is not None
    assert float(average.running_mean) == pytest.approx(0.9)
    assert average.num_batches_tracked is not None
    assert int(average.num_batches_tracked) == 1
