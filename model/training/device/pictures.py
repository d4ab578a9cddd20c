"""Pictures of many sizes in one tensor, from which random squares are cut without the host."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from model.data.augment import PHOTOGRAPH_SCALES, noise_textures


@dataclass(frozen=True)
class Pictures:
    """Pictures on one device.

    pixels : (all pixels, 3), row by row, picture after picture.
    starts, heights, widths : (pictures,) int64, a picture's first pixel and its size.
    """

    pixels: Tensor
    starts: Tensor
    heights: Tensor
    widths: Tensor

    @classmethod
    def join(cls, pictures: Sequence[Tensor], device: torch.device) -> "Pictures":
        """Join pictures (height, width, 3) of equal dtype."""
        heights, widths = (torch.tensor([picture.shape[axis] for picture in pictures]) for axis in (0, 1))
        sizes = heights * widths
        pixels = torch.cat([picture.reshape(-1, 3) for picture in pictures])
        return cls(*(each.to(device) for each in (pixels, sizes.cumsum(0) - sizes, heights, widths)))

    def pieces(self, count: int, side: int) -> Tensor:
        """Cut random squares of random pictures, half of them flipped: (count, 3, side, side) of the pixels' dtype."""
        device = self.pixels.device
        picture = _below(torch.full((count,), len(self.starts), device=device))
        width = self.widths[picture]
        top, left = _below(self.heights[picture] - side + 1), _below(width - side + 1)
        flipped = torch.rand(count, device=device) < 0.5
        along = torch.arange(side, device=device)
        columns = torch.where(flipped.view(-1, 1), along.flip(0), along) + left.view(-1, 1)  # (count, side)
        rows = (top.view(-1, 1) + along) * width.view(-1, 1) + self.starts[picture].view(-1, 1)
        index = rows.unsqueeze(2) + columns.unsqueeze(1)  # (count, side, side)
        return self.pixels[index].permute(0, 3, 1, 2)


def photograph_pictures(photographs: Sequence[Image.Image], side: int, device: torch.device) -> Pictures | None:
    """Return the photographs, RGB, each at several sizes, for frames of `side` pixels; None without any."""
    resized = []
    for photograph in photographs:
        for scale in PHOTOGRAPH_SCALES:
            factor = scale * side / min(photograph.size)
            size = [round(length * factor) for length in photograph.size]
            resized.append(torch.from_numpy(np.array(photograph.resize(size))))
    return Pictures.join(resized, device) if resized else None


def texture_pictures(side: int, device: torch.device) -> Pictures:
    """Return the textures of colored noise for frames of `side` pixels, float16 of unit variance."""
    return Pictures.join([texture.permute(1, 2, 0).half() for texture in noise_textures(side)], device)


def _below(limits: Tensor) -> Tensor:
    """Draw random integers in [0, limit): (n,) int64 -> (n,) int64."""
    drawn = (torch.rand(limits.shape, device=limits.device) * limits).long()
    return torch.minimum(drawn, limits - 1)
