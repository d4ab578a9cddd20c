"""Means of weights: the exponential moving average over a run, which is what is exported, and the mean of two runs."""

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
    """One step of the moving average, over weights and BatchNorm's statistics alike.

    Its decay is EMA_DECAY, and less in the first steps, so that the start is soon forgotten.
    """
    decay = ema_decay(step)
    now = network.state_dict()
    for name, kept in average.state_dict().items():
        if kept.is_floating_point():
            kept.lerp_(now[name], 1 - decay)
        else:
            kept.copy_(now[name])


def blend(run: Path, later: Path, share: float, out: Path) -> Path:
    """Write `out/best.pt`, the mean of two runs' chosen checkpoints, `share` of it the later one's; return its path.

    Of a run and one that started from it, the mean may be better than both (Wortsman et al. 2022, model soups). Either
    may be an exported model instead.

    Raises
    ------
    FileNotFoundError : a run has no checkpoint.
    ValueError : the runs are not of the same network, or `share` is not in [0, 1].
    """
    if not 0 <= share <= 1:
        raise ValueError(f"share is {share}, it must be from 0 to 1")
    (first, config, _), (second, later_config, spent) = (
        load_network(each if each.is_file() else chosen_checkpoint(each)) for each in (run, later)
    )
    for what in ("spec", "encoder", "framing", "method"):
        if getattr(config, what) != getattr(later_config, what):
            raise ValueError(f"{run} and {later} differ in their {what}")
    average, theirs = first.state_dict(), second.state_dict()
    for name, weight in average.items():
        average[name] = torch.lerp(weight, theirs[name], share) if weight.is_floating_point() else theirs[name]
    out.mkdir(parents=True, exist_ok=True)
    path = out / "best.pt"
    with whole_file(path) as file:
        torch.save({"config": later_config.to_dict(), "average": average, **spent}, file)
    return path
