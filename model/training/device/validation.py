"""Validation of a run on its device: the figures of `model.training.validation`, in batches."""

from typing import Final

import torch
from torch import Tensor, nn

from model.config import TrainConfig
from model.data.dataset import plain_images
from model.data.packed.tensors import Tensors, dequantize
from model.data.rendering.partial import SURFACE, fixed_parts
from model.networks.encoder import channels_last
from model.networks.ops.dispatch import nearest_index
from model.training.device.draws import in_frame
from model.training.losses import gather
from service.mapping.canonical import canonical_points

VIEWS: Final = (1, 13)  # of 24: from the front, a little to the side, and from behind
VALIDATION_POINTS: Final = 2_000  # predicted
TARGET_POINTS: Final = 4_000


@torch.no_grad()
def validate(network: nn.Module, config: TrainConfig, validation: Tensors) -> dict[str, float]:
    """Return means over the validation objects and VIEWS: `val`, which is cd_sq / 100, `f@1%` and `f@2%`."""
    device = validation.images.device
    canonical = torch.from_numpy(canonical_points(config.spec.domain, VALIDATION_POINTS, config.seed)).to(device)
    metrics = []
    for view in VIEWS:
        for units in validation.units.split(config.batch):  # type: ignore[no-untyped-call]
            first, own_end, _ = units.unbind(1)
            chosen = first + torch.minimum(torch.full_like(first, view), own_end - first - 1)
            true = in_frame(config.frame, _targets(validation, chosen), validation, chosen)
            images, true, scale = inputs_of(config, validation.images[chosen], true, view)
            predicted = network(channels_last(images), canonical.expand(len(images), -1, -1)) * scale
            metrics.append(_compare(predicted.float(), true[:, :TARGET_POINTS]))
    val, f1, f2 = torch.cat(metrics).mean(0).tolist()
    return {"val": val, "f@1%": f1, "f@2%": f2}


def inputs_of(config: TrainConfig, crops: Tensor, true: Tensor, view: int) -> tuple[Tensor, Tensor, Tensor]:
    """Return what an encoder sees of objects in a view, their points as its frame has them, and its scale."""
    if config.encoder.takes_points:
        parts = fixed_parts(true, seed=view)
        return parts.clouds, true - parts.center, parts.scale
    return plain_images(crops, config.framing.size), true, true.new_ones(1)


def _targets(validation: Tensors, views: Tensor) -> Tensor:
    """Return points of the shapes that the views show, (b, SURFACE, 3)."""
    shapes = validation.shape_of[views]
    numbers = torch.arange(SURFACE, device=views.device) % validation.counts[shapes].view(-1, 1)
    return dequantize(validation.points[validation.starts[shapes].view(-1, 1) + numbers])


def _compare(predicted: Tensor, true: Tensor) -> Tensor:
    """Return cd_sq / 100, F@1% and F@2% of each pair: (b, n, 3), (b, m, 3) -> (b, 3)."""
    forward = (gather(true, nearest_index(predicted, true)) - predicted).square().sum(2)
    backward = (gather(predicted, nearest_index(true, predicted)) - true).square().sum(2)
    columns = [forward.mean(1) + backward.mean(1)]
    for threshold in (0.01, 0.02):
        precision, recall = ((each.sqrt() <= threshold).float().mean(1) for each in (forward, backward))
        columns.append(2 * precision * recall / (precision + recall).clamp(min=1e-9))
    return torch.stack(columns, dim=1)
