"""The matte network: an image becomes the share of each pixel that is object.

EfficientNet-Lite0's convolutions, from ImageNet's weights, and a decoder that joins their maps from coarse to fine, as
U-Net does (Ronneberger, Fischer, Brox 2015).
"""

from typing import Final

import torch
import torch.nn.functional as nnf
from torch import Tensor, nn

from model.networks.lite0 import MEAN, SPREAD, STAGES, Lite0, load_imagenet
from model.networks.precision import trunk_precision

WIDTHS: Final = (16, 24, 40, 64, 96)  # maps of the decoder at strides 2, 4, 8, 16, 32
SHARPEN: Final = 2  # the last maps have half of the image's resolution


class MatteNetwork(nn.Module):
    """Images (b, 3, s, s) in [0, 1], s a multiple of 32 -> logits of the matte (b, 1, s, s)."""

    def __init__(self) -> None:
        super().__init__()
        self.trunk = Lite0(frozen=0)
        taps = _taps()
        maps = [STAGES[stage][-1] for stage in taps.values()]
        self._taps = tuple(taps)
        self.coarsest = nn.Conv2d(maps[-1], WIDTHS[-1], 1)
        self.joints = nn.ModuleList(
            Joint(coarse, lateral, width)
            for coarse, lateral, width in zip(WIDTHS[1:], maps[:-1], WIDTHS[:-1], strict=True)
        )
        self.last = nn.Conv2d(WIDTHS[0], SHARPEN**2, 3, padding=1)

    def forward(self, images: Tensor) -> Tensor:
        """Return the logits."""
        with trunk_precision(images.device, self.training):
            x = nnf.relu6(self.trunk.stem((images.flip(2, 3) - MEAN) / SPREAD))
            maps = []
            for index, block in enumerate(self.trunk.blocks):
                x = block(x)
                if index in self._taps:
                    maps.append(x)
            x = nnf.relu(self.coarsest(maps.pop()))
            for joint in reversed(self.joints):
                x = joint(x, maps.pop())
            # turned by 180 degrees as the trunk's maps are, so that the pixels of each square come in reverse, too
            logits: Tensor = nnf.pixel_shuffle(self.last(x), SHARPEN).flip(2, 3)
        return logits.float()

    @classmethod
    def pretrained(cls) -> "MatteNetwork":
        """Return a network with ImageNet's weights in its trunk. Raises ModuleNotFoundError without them."""
        network = cls()
        load_imagenet(network.trunk)
        return network


class Joint(nn.Module):
    """Coarse maps, enlarged twofold, and maps of the trunk become maps of that resolution."""

    def __init__(self, coarse: int, lateral: int, width: int) -> None:
        super().__init__()
        self.mix = nn.Conv2d(coarse + lateral, width, 1)
        self.filter = nn.Conv2d(width, width, 3, padding=1)

    def forward(self, coarse: Tensor, lateral: Tensor) -> Tensor:
        """Join (b, coarse, s, s) and (b, lateral, 2 s, 2 s): (b, width, 2 s, 2 s)."""
        enlarged = nnf.interpolate(coarse, scale_factor=2.0, mode="bilinear", align_corners=False)
        x = nnf.relu(self.mix(torch.cat([enlarged, lateral], dim=1)))
        joined: Tensor = nnf.relu(self.filter(x)) + x
        return joined


def _taps() -> dict[int, int]:
    """Return the last block of each resolution, with its stage."""
    taps: dict[int, int] = {}
    last = -1
    for stage, (blocks, _, stride, *_) in enumerate(STAGES):
        if stride == 2 and last >= 0:
            taps[last] = stage - 1
        last += blocks
    return taps | {last: len(STAGES) - 1}
