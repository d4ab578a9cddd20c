"""Validation of a run: fixed views of the validation split, on white, or fixed parts of its surfaces."""

import numpy as np
import torch
from torch import Tensor, nn

from model.config import TrainConfig
from model.data.dataset import Examples
from model.metrics import compare
from model.networks.encoder import channels_last
from model.training.device.validation import TARGET_POINTS, VALIDATION_POINTS, VIEWS, inputs_of
from service.mapping.canonical import canonical_points


@torch.no_grad()
def validate(network: nn.Module, config: TrainConfig, validation: Examples) -> dict[str, float]:
    """Return means over the validation objects and VIEWS: `val`, which is cd_sq / 100, `f@1%` and `f@2%`."""
    canonical = torch.from_numpy(canonical_points(config.spec.domain, VALIDATION_POINTS, config.seed))
    metrics = []
    for view in VIEWS:
        crops, points = validation.built(view, config.frame)
        for start in range(0, len(crops), config.batch):
            true = torch.from_numpy(points[start : start + config.batch])
            shown = torch.from_numpy(crops[start : start + config.batch])
            images, true, scale = inputs_of(config, shown, true, view)
            predicted: Tensor = network(channels_last(images), canonical.expand(len(images), -1, -1)) * scale
            clouds = zip(predicted.numpy(), true[:, :TARGET_POINTS].numpy(), strict=True)
            metrics += [compare(*each) for each in clouds]
    means = {name: float(np.mean([each[name] for each in metrics])) for name in ("cd_sq", "f@1%", "f@2%")}
    return {"val": means.pop("cd_sq") / 100, **means}
