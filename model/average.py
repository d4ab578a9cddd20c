"""The exponential moving average of a network's weights: smoother than its last step, and what is exported."""

from typing import Final

import torch
from torch import nn

EMA_DECAY: Final = 0.999  # per step


@torch.no_grad()
def update_average(average: nn.Module, network: nn.Module, step: int) -> None:
    """One step of the moving average, over weights and BatchNorm's statistics alike.

    Its decay is EMA_DECAY, and less in the first steps, so that the start is soon forgotten.
    """
    decay = min(EMA_DECAY, (1 + step) / (10 + step))
    now = network.state_dict()
    for name, kept in average.state_dict().items():
        if kept.is_floating_point():
            kept.lerp_(now[name], 1 - decay)
        else:
            kept.copy_(now[name])
