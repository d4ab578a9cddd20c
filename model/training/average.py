"""Means of weights: the moving average over a run, which is exported, and the blend of two runs."""

from pathlib import Path
from typing import Final

import torch
from torch import nn

from model.training.checkpoints import chosen_checkpoint, load_network
from service.files import whole_file

EMA_DECAY: Final = 0.999  # per step


def ema_decay(step: int) -> float:
    """Return the moving average's decay at a step: EMA_DECAY, and less in the first ones."""
    return min(EMA_DECAY, (1 + step) / (10 + step))


@torch.no_grad()
def update_average(average: nn.Module, network: nn.Module, step: int) -> None:
    """Move the average one step, over weights and BatchNorm's statistics alike.

    The decay is EMA_DECAY, and less in the first steps, so that the start is soon forgotten.
    """
    decay = ema_decay(step)
    current = network.state_dict()
    for name, mean in average.state_dict().items():
        if mean.is_floating_point():
            mean.lerp_(current[name], 1 - decay)
        else:
            mean.copy_(current[name])


def blend(run: Path, later: Path, share: float, out: Path) -> Path:
    """Write `out/best.pt`, the mean of two runs' chosen checkpoints, and return its path.

    The mean of a run and one that started from it may be better than both (Wortsman et al. 2022, model soups). Either
    may be an exported model instead. `share` is the weight of the later run.

    Raises
    ------
    FileNotFoundError : a run has no checkpoint.
    ValueError : the runs are not of the same network, or `share` is not in [0, 1].
    """
    if not 0 <= share <= 1:
        raise ValueError(f"--share is {share}, it must be from 0 to 1")
    (first, config, _), (second, later_config, spent) = (
        load_network(each if each.is_file() else chosen_checkpoint(each)) for each in (run, later)
    )
    for part in ("spec", "encoder", "framing", "method"):
        if getattr(config, part) != getattr(later_config, part):
            raise ValueError(f"{run} and {later} differ in their {part}: only runs of one network can be blended")
    average, later_weights = first.state_dict(), second.state_dict()
    for name, weight in average.items():
        other = later_weights[name]
        average[name] = torch.lerp(weight, other, share) if weight.is_floating_point() else other
    out.mkdir(parents=True, exist_ok=True)
    path = out / "best.pt"
    with whole_file(path) as file:
        torch.save({"config": later_config.to_dict(), "average": average, **spent}, file)
    return path
