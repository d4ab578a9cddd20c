"""The paper's DenseNet (appendix: baseline encoder), and the same on a grid of cells in place of an image."""

from typing import Final

import torch
from torch import Tensor, nn

from model.config import EncoderConfig

SIDE: Final = 64  # cells of a grid


class DenseMaps(nn.Sequential):
    """The DenseNet of the paper's baseline encoder, on images of `channels`."""

    def __init__(self, config: EncoderConfig, channels: int = 3) -> None:
        blocks: list[nn.Module] = [nn.Conv2d(channels, config.feature_maps[0], 3, stride=2, padding=1, bias=False)]
        maps = config.feature_maps[0]
        for growth in config.feature_maps:
            blocks.append(DenseBlock(maps, growth, config.convolutions))
            grown = maps + config.convolutions * growth
            maps = grown // 2
            blocks += [nn.BatchNorm2d(grown), nn.ReLU(), nn.Conv2d(grown, maps, 1, bias=False), nn.AvgPool2d(2)]
        super().__init__(*blocks)
        self.maps = maps
        self.stride = 2 ** (1 + len(config.feature_maps))

    def forward(self, images: Tensor) -> Tensor:
        """Return the feature maps: (b, channels, s, s) in [0, 1] -> (b, `maps`, s / `stride`, s / `stride`)."""
        return self.convolve(2 * images - 1)

    def convolve(self, x: Tensor) -> Tensor:
        """Return the feature maps of values around 0, or of few that are not: shapes as of `forward`."""
        maps: Tensor = super().forward(x)  # type: ignore[no-untyped-call]
        return maps


class DenseBlock(nn.Module):
    """`convolutions` 3x3 convolutions, each reading all maps before it and adding `growth`."""

    def __init__(self, maps: int, growth: int, convolutions: int) -> None:
        super().__init__()
        self.layers = nn.ModuleList(
            nn.Sequential(
                nn.BatchNorm2d(maps + index * growth),
                nn.ReLU(),
                nn.Conv2d(maps + index * growth, growth, 3, padding=1, bias=False),
            )
            for index in range(convolutions)
        )

    def forward(self, x: Tensor) -> Tensor:
        """Append each convolution's maps: (b, maps, h, w) -> (b, maps + convolutions * growth, h, w)."""
        for layer in self.layers:
            x = torch.cat([x, layer(x)], dim=1)
        return x


class GridMaps(nn.Module):
    """Features of a cloud: a DenseNet whose channels are the horizontal slices of a grid around the points.

    A cell is 1 if a point lies in it, else 0. The order of the points and their repetition change nothing, so a cloud
    of any size fits. `maps` is the number of features.
    """

    def __init__(self, config: EncoderConfig) -> None:
        super().__init__()
        self.slices = DenseMaps(config, SIDE)
        self.maps = self.slices.maps * (SIDE // self.slices.stride) ** 2

    def forward(self, points: Tensor) -> Tensor:
        """Return the features: (b, n, 3), box centered at the origin, its longest side 1 -> (b, `maps`)."""
        x, y, z = ((points + 0.5) * SIDE).long().clamp(0, SIDE - 1).unbind(2)
        cells = points.new_zeros(points.shape[0], SIDE**3).scatter(1, (z * SIDE + x) * SIDE + y, 1.0)
        slices = cells.view(-1, SIDE, SIDE, SIDE).permute(0, 3, 1, 2)  # (b, y, z, x), channels last in memory
        features: Tensor = self.slices.convolve(slices).flatten(1)
        return features
