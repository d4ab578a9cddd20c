"""ResNet18's convolutions (He et al. 2016), from random weights; its pooling and classifier are left out."""

from typing import Final

import torch
import torch.nn.functional as nnf
from torch import Tensor, nn

WIDTHS: Final = (64, 128, 256, 512)
BLOCKS: Final = 2  # of each width


class ResNetMaps(nn.Module):
    """Convolution of 7 x 7, pooling, and four stages of two blocks each."""

    maps: Final = WIDTHS[-1]
    stride: Final = 32

    def __init__(self) -> None:
        super().__init__()
        self.first = nn.Conv2d(3, WIDTHS[0], 7, stride=2, padding=3, bias=False)
        self.norm = nn.BatchNorm2d(WIDTHS[0])
        blocks: list[nn.Module] = []
        width = WIDTHS[0]
        for stage, out in enumerate(WIDTHS):
            for number in range(BLOCKS):
                blocks.append(Block(width, out, stride=2 if stage and not number else 1))
                width = out
        self.blocks = nn.Sequential(*blocks)

    def forward(self, images: Tensor) -> Tensor:
        """Return the feature maps: (b, 3, s, s) in [0, 1] -> (b, 512, s / 32, s / 32)."""
        x = nnf.max_pool2d(self.norm(self.first(2 * images - 1)).relu(), 3, stride=2, padding=1)
        maps: Tensor = self.blocks(x)
        return maps


class Block(nn.Module):
    """Two convolutions of 3 x 3 whose result is added to the input, resized by one of 1 x 1 where widths differ."""

    def __init__(self, n_in: int, n_out: int, stride: int) -> None:
        super().__init__()
        self.first = nn.Conv2d(n_in, n_out, 3, stride=stride, padding=1, bias=False)
        self.second = nn.Conv2d(n_out, n_out, 3, padding=1, bias=False)
        self.norms = nn.ModuleList(nn.BatchNorm2d(n_out) for _ in range(2))
        self.short: nn.Module = nn.Identity()
        if stride > 1 or n_in != n_out:
            self.short = nn.Sequential(nn.Conv2d(n_in, n_out, 1, stride=stride, bias=False), nn.BatchNorm2d(n_out))

    def forward(self, x: Tensor) -> Tensor:
        """Return the maps: (b, n_in, s, s) -> (b, n_out, s / stride, s / stride)."""
        first, second = self.norms
        inner = second(self.second(first(self.first(x)).relu()))
        total: Tensor = torch.relu(inner + self.short(x))
        return total
