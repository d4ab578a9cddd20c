"""Heads behind a finished encoder: how well its own answer will fit, and the camera that took the photo.

They read the encoder's inner tensors (`model.networks.inner`) and change nothing in it. The azimuth is a distribution
over bins, since a view may fit two opposite sides; the answer is the mean direction around its highest place.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final

import torch
from torch import Tensor, nn

Sizes = Mapping[str, tuple[int, ...]]

CONFIDENCE_WIDTH: Final = 128
CAMERA_WIDTH: Final = 256
CAMERA_MEMBERS: Final = 2
DROPOUT: Final = (0.1, 0.3)  # of the inputs, of the hidden layers
CLIP: Final = 5.0  # standard deviations that an input counts at most
BINS: Final = 24  # of the azimuth
SHARPNESS: Final = 6.0  # of the kernel that smooths the bins
SPREAD: Final = 1e-3  # least standard deviation of an input
REST: Final = 3  # elevation, logarithm of the distance, roll: in standard deviations
FLAT: Final = ("maps",)  # the confidence does not read them: too many numbers for the few objects it learns from


class EstimateHeads(nn.Module):
    """Inner tensors of an encoder -> shape_confidence (b, 1) in [0, 1], camera (b, 4).

    The camera is azimuth and elevation in degrees, distance in longest sides, roll in degrees.
    """

    mean: Tensor
    spread: Tensor
    calibration: Tensor
    rest_mean: Tensor
    rest_spread: Tensor

    def __init__(self, sizes: Sizes, members: int) -> None:
        """Make heads for tensors of these sizes by name, without the batch; `members` confidences are averaged."""
        super().__init__()
        self.names: Final = tuple(sizes)
        widths = [2 * size[0] if len(size) > 1 else size[0] for size in sizes.values()]
        self._splits = widths
        narrow = sum(width for name, width in zip(self.names, widths, strict=True) if name not in FLAT)
        self.confidences = nn.ModuleList(_layers(narrow, CONFIDENCE_WIDTH, 1) for _ in range(members))
        self.cameras = nn.ModuleList(_layers(sum(widths), CAMERA_WIDTH, BINS + REST) for _ in range(CAMERA_MEMBERS))
        self.register_buffer("mean", torch.zeros(sum(widths)))
        self.register_buffer("spread", torch.ones(sum(widths)))
        self.register_buffer("calibration", torch.tensor([0.0, 1.0]))
        self.register_buffer("rest_mean", torch.zeros(REST))
        self.register_buffer("rest_spread", torch.ones(REST))

    def forward(self, *tensors: Tensor) -> tuple[Tensor, Tensor]:
        """Inner tensors in the order of `names` -> (b, 1), (b, 4)."""
        inputs = self.normalize(pool(tensors))
        narrow = self.narrow(inputs)
        logits = torch.stack([member(narrow) for member in self.confidences]).mean(dim=0)
        confidence = torch.sigmoid(self.calibration[0] + self.calibration[1] * logits)
        outputs = [member(inputs) for member in self.cameras]
        bins = torch.stack([output[:, :BINS].softmax(dim=1) for output in outputs]).mean(dim=0)
        rest = torch.stack([output[:, BINS:] for output in outputs]).mean(dim=0)
        rest = self.rest_mean + self.rest_spread * rest
        elevation, distance, roll = rest[:, :1], rest[:, 1:2].exp(), rest[:, 2:]
        return confidence, torch.cat([direction(bins), elevation, distance, roll], dim=1)

    def normalize_by(self, inputs: Tensor) -> None:
        """Take mean and spread of the pooled inputs (n, inputs) of the training images."""
        self.mean.copy_(inputs.mean(dim=0))
        self.spread.copy_(inputs.std(dim=0).clamp(min=SPREAD))

    def normalize(self, inputs: Tensor) -> Tensor:
        """Return pooled inputs (b, inputs) in standard deviations, clipped."""
        return ((inputs - self.mean) / self.spread).clamp(-CLIP, CLIP)

    def narrow(self, inputs: Tensor) -> Tensor:
        """Return the part of the inputs (b, inputs) that the confidences read."""
        parts = zip(self.names, torch.split(inputs, self._splits, dim=1), strict=True)
        return torch.cat([part for name, part in parts if name not in FLAT], dim=1)


def pool(tensors: Sequence[Tensor]) -> Tensor:
    """Return vectors (b, d) as they are, maps (b, c, h, w) as their means and largest values, side by side."""
    parts = []
    for tensor in tensors:
        parts += [tensor.mean(dim=(2, 3)), tensor.amax(dim=(2, 3))] if tensor.dim() > 2 else [tensor]
    return torch.cat(parts, dim=1)


def direction(bins: Tensor) -> Tensor:
    """Return the azimuth of distributions over bins (b, BINS), degrees: (b, 1), -180 to 180."""
    centers = torch.arange(BINS, device=bins.device) * (2 * math.pi / BINS)
    kernel = torch.exp(SHARPNESS * (torch.cos(centers[:, None] - centers) - 1))  # (BINS, BINS)
    around = kernel[(bins @ kernel).argmax(dim=1)] * bins
    sine, cosine = around @ torch.sin(centers), around @ torch.cos(centers)
    length = (sine**2 + cosine**2).sqrt()
    angle = 2 * torch.atan(sine / (length + cosine + 1e-9))  # atan2, of which ONNX knows nothing
    return (180 / math.pi * angle)[:, None]


def _layers(inputs: int, width: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Dropout(DROPOUT[0]),
        nn.Linear(inputs, width),
        nn.ReLU(),
        nn.Dropout(DROPOUT[1]),
        nn.Linear(width, width),
        nn.ReLU(),
        nn.Dropout(DROPOUT[1]),
        nn.Linear(width, outputs),
    )
