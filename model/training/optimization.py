"""The optimizer of a run: AdamW in groups, and its learning rate over the budget."""

import math
from typing import Any, Final

import torch
from torch import nn

from model.config import TrainConfig
from model.networks.lite0 import Lite0

WARMUP: Final = 0.02  # share of the budget


def make_optimizer(network: nn.Module, config: TrainConfig) -> torch.optim.AdamW:
    """Return AdamW over the trained weights; each group's `rate` is its share of the learning rate."""
    groups = _groups(network, config.pretrained_rate)
    return torch.optim.AdamW(groups, weight_decay=config.weight_decay, fused=True)


def _groups(network: nn.Module, pretrained_rate: float) -> list[dict[str, Any]]:
    """Return the trained weights in two groups, new ones and pretrained ones; a group without weights is left out."""
    pretrained = {weight for part in pretrained_parts(network) for weight in part.parameters()}
    trained = [weight for weight in network.parameters() if weight.requires_grad]
    groups = [
        {"params": [weight for weight in trained if (weight in pretrained) == is_pretrained], "rate": rate}
        for is_pretrained, rate in ((False, 1.0), (True, pretrained_rate))
    ]
    return [group for group in groups if group["params"]]


def pretrained_parts(network: nn.Module) -> list[Lite0]:
    """Return the modules that start from ImageNet's weights."""
    return [part for part in network.modules() if isinstance(part, Lite0)]


def set_learning_rate(
    optimizer: torch.optim.Optimizer, learning_rate: float, progress: float, constant: bool = False
) -> None:
    """Set each group's learning rate for `progress` in [0, 1]; `rate`, where a group has it, is its share."""
    for group in optimizer.param_groups:
        group["lr"] = group.get("rate", 1.0) * learning_rate * schedule(progress, constant)


def schedule(progress: float, constant: bool = False) -> float:
    """Return the share of the learning rate at `progress` in [0, 1]: linear warm-up, then a cosine to 0; or 1."""
    if constant:
        return 1.0
    if progress < WARMUP:
        return max(progress / WARMUP, 1e-3)
    return 0.5 * (1 + math.cos(math.pi * progress))
