"""AtlasNet (Groueix et al. 2018): patches that a code bends into a surface, as a sphere or as 25 squares."""

from typing import Final

import torch
import torch.nn.functional as nnf
from torch import Tensor, nn

from model.config import TrainConfig
from model.networks.encoder import ImageTrunk

CODE: Final = 1_024
PATCHES: Final = 25


class Patch(nn.Module):
    """Layers d + 1024, d + 1024, half, a quarter of that, 3: batch normalization and ReLU between them, tanh last.

    The code's part of the first layer is the same for all points of an object, so it is computed once.
    """

    def __init__(self, inputs: int) -> None:
        super().__init__()
        width = inputs + CODE
        self.first = nn.Linear(width, width)
        self.second = nn.Linear(width, width // 2)
        self.third = nn.Linear(width // 2, width // 4)
        self.last = nn.Linear(width // 4, 3)
        self.norms = nn.ModuleList(nn.BatchNorm1d(size) for size in (width, width // 2, width // 4))

    def forward(self, x: Tensor, code: Tensor) -> Tensor:
        """Bend points: (b, n, d), (b, CODE) -> (b, n, 3)."""
        of_points, of_code = self.first.weight.split([x.shape[2], CODE], dim=1)  # type: ignore[no-untyped-call]
        x = nnf.linear(x, of_points) + nnf.linear(code, of_code, self.first.bias).unsqueeze(1)
        first, second, third = self.norms
        x = self.second(_normalized(first, x))
        x = self.third(_normalized(second, x))
        points: Tensor = self.last(_normalized(third, x)).tanh()
        return points


def _normalized(norm: nn.Module, x: Tensor) -> Tensor:
    """Normalize each feature over all points of the batch: (b, n, f) -> (b, n, f), after ReLU."""
    flat: Tensor = norm(x.flatten(0, 1)).relu()
    return flat.reshape(x.shape)  # (b, n, f)


class AtlasNet(nn.Module):
    """One patch from the sphere, or PATCHES from the unit square, behind the common trunk.

    Points are dealt out to the patches in turn, so that each draws as many. Of a canonical point in the cube x and y
    are the place in the square.
    """

    depth: Final = 4  # layers of each patch

    def __init__(self, config: TrainConfig) -> None:
        super().__init__()
        self.trunk = ImageTrunk(config.encoder, config.framing.size)
        self.code = nn.Linear(self.trunk.width, CODE)
        self.is_sphere = config.method == "atlasnet_sphere"
        self.patches = nn.ModuleList([Patch(3)] if self.is_sphere else [Patch(2) for _ in range(PATCHES)])

    def forward(self, images: Tensor, canonical: Tensor) -> Tensor:
        """Return the points: (b, 3, s, s), (b, n, 3) -> (b, n, 3)."""
        code = self.code(self.trunk(images))
        if self.is_sphere:
            sphere: Tensor = self.patches[0](canonical, code)
            return sphere
        square = (canonical[..., :2] + 1) / 2
        used = min(PATCHES, square.shape[1])
        bent = [patch(square[:, turn::PATCHES], code) for turn, patch in enumerate(self.patches) if turn < used]
        points = torch.empty(*square.shape[:2], 3, dtype=bent[0].dtype, device=square.device)
        for turn, part in enumerate(bent):
            points[:, turn::PATCHES] = part
        return points
