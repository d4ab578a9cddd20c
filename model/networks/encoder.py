"""The image encoder g_phi: an image becomes theta (paper, eq. 1; appendix: baseline encoder).

Top to bottom: the image encoder and its last layer; the trunk in front of them, which the compared methods share;
the trunk's convolutions on a pretrained EfficientNet-Lite0. Modules of their own have the paper's DenseNet and
ResNet18, and the two whose input is points: PointNet, and the DenseNet on a grid.
`model.networks.mapping` turns theta into points.
"""

from collections.abc import Callable
from typing import Final, Union

import numpy as np
import numpy.typing as npt
import torch
import torch.nn.functional as nnf
from torch import Tensor, nn

from model.config import EncoderConfig, Predicted
from model.networks import lite0
from model.networks.densenet import DenseMaps, GridMaps
from model.networks.lite0 import Lite0
from model.networks.pointnet import PointMaps
from model.networks.precision import trunk_precision
from model.networks.resnet18 import ResNetMaps
from service.mapping.spec import MappingSpec, initial_theta

Maps = Union[DenseMaps, "LiteMaps", ResNetMaps, PointMaps, GridMaps]

HEAD_SCALE: Final = 0.2  # of theta_0: how far objects differ at the start; exactly zero stalls
DROPOUT: Final = 0.2  # of the maps at the end of the pretrained convolutions


class ImageTrunk(nn.Module):
    """Convolutions and fully connected layers that every method shares: an RGB image, or points, become features.

    `width` is the number of features: the rank, or without one the width of the last fully connected layer. In
    training the trunk computes in bfloat16 where the device gains by it; in evaluation always in float32.
    """

    def __init__(self, config: EncoderConfig, size: int) -> None:
        super().__init__()
        kinds: dict[str, Callable[[EncoderConfig], Maps]] = {
            "dense": DenseMaps,
            "lite0": LiteMaps,
            "resnet18": lambda _: ResNetMaps(),
            "pointnet": PointMaps,
            "grid": GridMaps,
        }
        self.features = kinds[config.trunk](config)
        width = self.features.maps
        if not isinstance(self.features, (PointMaps, GridMaps)):
            width *= (size // self.features.stride) ** 2
        dense: list[nn.Module] = []
        for n_out in config.fully_connected:
            dense += [nn.Linear(width, n_out), nn.ReLU()]
            width = n_out
        if config.rank:
            dense += [nn.Linear(width, config.rank), nn.LayerNorm(config.rank)]
            width = config.rank
        self.dense = nn.Sequential(*dense)
        self.width = width

    def forward(self, image: Tensor) -> Tensor:
        """Return the features: (b, 3, size, size) in [0, 1], or points (b, n, 3) -> (b, width)."""
        return self.look(image)[1]

    def look(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """Return the last feature maps (b, maps, side, side) of images (b, 3, size, size), and features (b, width)."""
        with trunk_precision(image.device, self.training):
            maps: Tensor = self.features(image)
            features: Tensor = self.dense(maps.flatten(1))
        return maps.float(), features.float()


class ImageEncoder(ImageTrunk):
    """g_phi: an RGB image becomes theta (paper, eq. 1); of a point encoder, points of a part of a surface do.

    The last layer starts as theta_0, an ordinary initialization of f, plus small weights, so that
    every object starts as the same sane function.
    """

    def __init__(self, spec: MappingSpec, config: EncoderConfig, size: int) -> None:
        super().__init__(config, size)
        self.head = ThetaHead(spec, self.width, config.predicted)

    def forward(self, image: Tensor) -> Tensor:
        """Return theta: (b, 3, size, size) in [0, 1], or points (b, n, 3) -> (b, spec.size)."""
        theta: Tensor = self.head(super().forward(image))
        return theta


class ThetaHead(nn.Module):
    """theta = theta_0 + scale * (W h + b), scale being the spread of each layer's own initialization.

    The scale lets one step of Adam move every layer of f by the same share of its size. Without it the first
    steps blow f up, since the 1,024 hidden units of HOF-1 move together.

    Of the numbers outside the `predicted` part only b is learned: they are the same for all images.
    """

    theta_0: Tensor
    scale: Tensor
    mask: Tensor

    def __init__(self, spec: MappingSpec, width: int, predicted: Predicted = "all") -> None:
        super().__init__()
        self.linear = nn.Linear(width, spec.size)
        nn.init.normal_(self.linear.weight, 0, HEAD_SCALE / width**0.5)
        nn.init.zeros_(self.linear.bias)
        theta_0 = torch.from_numpy(initial_theta(spec))
        spread, start = torch.empty_like(theta_0), 0
        for n_out, n_in in spec.shapes:
            end = start + n_out * n_in + n_out
            spread[start:end] = theta_0[start:end].std()
            start = end
        self.register_buffer("theta_0", theta_0)
        self.register_buffer("scale", spread)
        self.is_partial = predicted != "all"
        self.register_buffer("mask", torch.from_numpy(predicted_mask(spec, predicted)), persistent=False)

    def forward(self, x: Tensor) -> Tensor:
        """Return theta: (b, width) -> (b, spec.size)."""
        if self.is_partial:
            return self.theta_0 + self.scale * (self.mask * nnf.linear(x, self.linear.weight) + self.linear.bias)
        theta: Tensor = self.theta_0 + self.scale * self.linear(x)
        return theta


def predicted_mask(spec: MappingSpec, predicted: Predicted) -> npt.NDArray[np.float32]:
    """Return 1 for each number of theta in the predicted part, else 0: (spec.size,)."""
    parts = []
    for layer, (n_out, n_in) in enumerate(spec.shapes):
        is_first = layer == 0
        weights = predicted == "all" or (predicted == "first_layer" and is_first)
        biases = is_first or predicted in ("all", "biases")
        parts += [np.full(n_out * n_in, weights), np.full(n_out, biases)]
    return np.concatenate(parts).astype(np.float32)


class LiteMaps(nn.Module):
    """A pretrained EfficientNet-Lite0: its last maps, reduced in number, then its finer maps, four cells to one."""

    def __init__(self, config: EncoderConfig) -> None:
        super().__init__()
        self.lite0 = Lite0(config.frozen)
        self.joined = nn.Conv2d(lite0.MAPS, config.joined_maps, 1)
        self.fine = nn.Conv2d(lite0.FINE_MAPS, config.fine_maps, 1) if config.fine_maps else None
        self.maps = config.joined_maps + 4 * config.fine_maps
        self.stride = lite0.STRIDE
        self.dropout = DROPOUT

    def forward(self, images: Tensor) -> Tensor:
        """Return the feature maps: (b, 3, s, s) in [0, 1] -> (b, `maps`, s / `stride`, s / `stride`)."""
        fine, last = self.lite0.look(images)
        maps = self.joined(last)
        if self.fine is not None:
            maps = torch.cat([maps, _unshuffle(self.fine(fine), self.fine.out_channels)], dim=1)
        return nnf.dropout(nnf.relu(maps), self.dropout, self.training)


def channels_last(inputs: Tensor) -> Tensor:
    """Return images in the memory format that convolutions like best, and points as they are."""
    return inputs.contiguous(memory_format=torch.channels_last) if inputs.dim() == 4 else inputs


def _unshuffle(maps: Tensor, count: int) -> Tensor:
    """Return nnf.pixel_unshuffle(maps, 2) of `count` maps, by convolution: torch's exporter then knows the sizes."""
    kernels = torch.eye(4, device=maps.device).view(4, 1, 2, 2).repeat(count, 1, 1, 1)
    return nnf.conv2d(maps, kernels, stride=2, groups=count)
