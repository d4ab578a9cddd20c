"""Validation of a run: fixed views of the validation split, on white."""

import numpy as np
import torch
from torch import Tensor, nn

from model.config import TrainConfig
from model.data.dataset import Examples, plain_images
from model.metrics import compare
from model.training.device.validation import TARGET_POINTS, VALIDATION_POINTS, VIEWS
from service.mapping.canonical import canonical_points


@torch.no_grad()
def validate(network: nn.Module, config: TrainConfig, validation: Examples) -> dict[str, float]:
    """Return means over the validation objects and VIEWS: `val`, which is cd_sq / 100, `f@1%` and `f@2%`."""
    canonical = torch.from_numpy(canonical_points(config.spec.domain, VALIDATION_POINTS, config.seed))
    metrics = []
    for view in VIEWS:
        crops, points = validation.built(view, config.frame)
        for start in range(0, len(crops), config.batch):
            images = plain_images(torch.from_numpy(crops[start : start + config.batch]), config.framing.size)
            images = images.contiguous(memory_format=torch.channels_last)
            predicted: Tensor = network(images, canonical.expand(len(images), -1, -1))
            true = points[start : start + config.batch, :TARGET_POINTS]
            metrics += [compare(*clouds) for clouds in zip(predicted.numpy(), true, strict=True)]
    means = {name: float(np.mean([each[name] for each in metrics])) for name in ("cd_sq", "f@1%", "f@2%")}
    return {"val": means.pop("cd_sq") / 100, **means}
