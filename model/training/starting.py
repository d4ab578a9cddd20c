"""The weights that a run takes from another one."""

from dataclasses import replace

import torch
import torch.nn.functional as nnf
from torch import Tensor

from model.config import TrainConfig

Weights = dict[str, Tensor]


def starting_weights(start: Weights, start_config: TrainConfig, own: Weights, config: TrainConfig) -> Weights:
    """Return the weights to begin with: those of `start` where the parts of both networks agree, else `own`.

    With another trunk, `start` gives the head's weights; with another spec, the trunk's. A trunk with finer maps
    besides counts as the same: the weights that read them start at zero.

    Raises
    ------
    ValueError : another method or rank, or both another trunk and another spec.
    """
    for quantity, start_value, value in (
        ("method", start_config.method, config.method),
        ("rank", start_config.encoder.rank, config.encoder.rank),
    ):
        if start_value != value:
            raise ValueError(f"{config.start} was trained with another {quantity}: {start_value}, this run has {value}")
    same_trunk = has_same_trunk(start_config, config)
    same_head = start_config.spec == config.spec
    shared = {name for name in own if (same_head if ".head." in name else same_trunk and name in start)}
    if not shared:
        raise ValueError(
            f"{config.start} was trained with another trunk and another spec: it has no weights for this network"
        )
    return own | {name: _widen(start[name], own[name].shape) for name in shared}


def has_same_trunk(start_config: TrainConfig, config: TrainConfig) -> bool:
    """Return whether a run's trunk takes its weights from `start_config`'s.

    Finer maps besides do not matter, nor how many layers are trained.
    """
    encoder = replace(config.encoder, frozen=start_config.encoder.frozen)
    coarse = replace(encoder, fine_maps=0)
    return start_config.encoder in (encoder, coarse) and start_config.framing == config.framing


def _widen(weight: Tensor, shape: torch.Size) -> Tensor:
    """Return the weight with zeros for the inputs that it lacks."""
    return weight if weight.shape == shape else nnf.pad(weight, (0, shape[1] - weight.shape[1]))
