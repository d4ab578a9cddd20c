"""The compared methods: HOF, and other decoders behind the same trunk; AtlasNet is in `model.networks.atlasnet`.

Each is a module: images (b, 3, s, s) in [0, 1] and canonical points (b, n, d) -> points (b, n, 3). The
latent vector concatenation (LVC) decoders have the paper's sizes: DeepSDF 1,578,241 parameters, FoldingNet
1,056,775. Their fourth output is in the paper's counts and unused.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Final

import torch
import torch.nn.functional as nnf
from torch import Tensor, nn

from model.config import METHOD_DOMAINS, TrainConfig
from model.networks.atlasnet import AtlasNet
from model.networks.encoder import ImageEncoder, ImageTrunk
from model.networks.mapping import power
from model.networks.precision import trunk_precision

DEEPSDF_CODE: Final = 256
FOLDINGNET_CODE: Final = 512
DIRECT_POINTS: Final = 1_024


def make_network(config: TrainConfig) -> nn.Module:
    """Return the network of `config.method`, initialized from torch's generator.

    Raises
    ------
    ValueError : foldingnet or AtlasNet without the canonical domain that it needs.
    """
    domain = METHOD_DOMAINS.get(config.method, config.spec.domain)
    if config.spec.domain != domain:
        raise ValueError(f"{config.method} takes its points from the domain {domain!r}, not {config.spec.domain!r}")
    kinds: dict[str, Callable[[TrainConfig], nn.Module]] = {
        "hof": Hof,
        "deepsdf": DeepSdf,
        "foldingnet": FoldingNet,
        "direct": Direct,
        "atlasnet_sphere": AtlasNet,
        "atlasnet_25": AtlasNet,
    }
    return kinds[config.method](config)


class Lvc(nn.Module):
    """Fully connected layers with ReLU between them, for every point with the code appended.

    The code's part of the first layer is the same for all points of an object, so it is computed once. In
    training the layers between the first and the last compute in bfloat16, as the trunk does.
    """

    def __init__(self, widths: Sequence[int]) -> None:
        super().__init__()
        self.first = nn.Linear(widths[0], widths[1])
        self.others = nn.ModuleList(nn.Linear(n_in, n_out) for n_in, n_out in pairwise(widths[1:]))
        for layer in (self.first, *self.others):
            nn.init.kaiming_normal_(layer.weight)
            nn.init.zeros_(layer.bias)

    def forward(self, x: Tensor, code: Tensor) -> Tensor:
        """Apply the layers to points and code: (b, n, d), (b, c) with d + c = widths[0] -> (b, n, widths[-1])."""
        point_weights, code_weights = self.first.weight.split([x.shape[2], code.shape[1]], dim=1)  # type: ignore[no-untyped-call]
        x = nnf.linear(x, point_weights) + nnf.linear(code, code_weights, self.first.bias).unsqueeze(1)
        *between, last = self.others
        with trunk_precision(x.device, self.training):
            for layer in between:
                x = layer(x.relu())
        points: Tensor = last(x.float().relu())
        return points


class Hof(nn.Module):
    """f_theta^k on the canonical points, theta from the image (paper, eq. 1 and 4)."""

    def __init__(self, config: TrainConfig) -> None:
        super().__init__()
        self.spec = config.spec
        self.encoder = ImageEncoder(config.spec, config.encoder, config.framing.size)

    def forward(self, images: Tensor, canonical: Tensor) -> Tensor:
        """Return the points: (b, 3, s, s), (b, n, d) -> (b, n, 3)."""
        return power(self.spec, self.encoder(images), canonical)


class DeepSdf(nn.Module):
    """LVC decoder 259-512-512-512-253, skip of the 259 inputs, 512-512-512-512-4 (Park et al. 2019)."""

    def __init__(self, config: TrainConfig) -> None:
        super().__init__()
        self.trunk = ImageTrunk(config.encoder, config.framing.size)
        self.code = nn.Linear(self.trunk.width, DEEPSDF_CODE)
        inputs = 3 + DEEPSDF_CODE
        self.first = Lvc([inputs, 512, 512, 512, 512 - inputs])
        self.second = Lvc([512, 512, 512, 512, 4])

    def forward(self, images: Tensor, canonical: Tensor) -> Tensor:
        """Return the points: (b, 3, s, s), (b, n, 3) -> (b, n, 3)."""
        code = self.code(self.trunk(images))
        x = self.first(canonical, code).relu()
        points: Tensor = self.second(torch.cat([x, canonical], dim=2), code)[..., :3]
        return points


class FoldingNet(nn.Module):
    """LVC decoder of two folds of a 2D grid, 514-512-512-3 and 515-512-512-4 (Yang et al. 2018)."""

    def __init__(self, config: TrainConfig) -> None:
        super().__init__()
        self.trunk = ImageTrunk(config.encoder, config.framing.size)
        self.code = nn.Linear(self.trunk.width, FOLDINGNET_CODE)
        self.first = Lvc([2 + FOLDINGNET_CODE, 512, 512, 3])
        self.second = Lvc([3 + FOLDINGNET_CODE, 512, 512, 4])

    def forward(self, images: Tensor, canonical: Tensor) -> Tensor:
        """Return the points: (b, 3, s, s), (b, n, 3) in the cube, x and y being the grid's -> (b, n, 3)."""
        code = self.code(self.trunk(images))
        folded = self.first(canonical[..., :2], code)
        points: Tensor = self.second(folded, code)[..., :3]
        return points


class Direct(nn.Module):
    """A fully connected layer that outputs DIRECT_POINTS points (PSG: Fan et al. 2017)."""

    def __init__(self, config: TrainConfig) -> None:
        super().__init__()
        self.trunk = ImageTrunk(config.encoder, config.framing.size)
        self.head = nn.Linear(self.trunk.width, DIRECT_POINTS * 3)

    def forward(self, images: Tensor, canonical: Tensor) -> Tensor:
        """Return the points: (b, 3, s, s) -> (b, DIRECT_POINTS, 3), for any number of canonical points."""
        points: Tensor = self.head(self.trunk(images)).unflatten(1, (DIRECT_POINTS, 3))
        return points
