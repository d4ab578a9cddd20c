"""PointNet (Qi et al. 2017) in the two stages of PCN's encoder (Yuan et al. 2018): points become features.

Every layer acts on each point alone, and a maximum over all points follows. The order of the points and their
repetition change nothing, so a cloud of any size fits.
"""

from typing import Final

import torch.nn.functional as nnf
from torch import Tensor, nn

from model.config import EncoderConfig

LAYERS: Final = 4


class PointMaps(nn.Module):
    """Features of a cloud: two layers on each point and their maximum; two more, which see that maximum, and theirs.

    `maps` is the number of features. Raises ValueError if `config.point_maps` has not one width per layer.
    """

    def __init__(self, config: EncoderConfig) -> None:
        super().__init__()
        if len(config.point_maps) != LAYERS:
            raise ValueError(f"point_maps has {len(config.point_maps)} widths, PointNet has {LAYERS} layers")
        first, second, third, last = config.point_maps
        self.first = nn.Sequential(nn.Conv1d(3, first, 1), nn.ReLU(), nn.Conv1d(first, second, 1))
        self.of_point = nn.Conv1d(second, third, 1, bias=False)
        self.of_cloud = nn.Linear(second, third)  # both together are one layer on each point with the maximum appended
        self.last = nn.Conv1d(third, last, 1)
        self.maps = last

    def forward(self, points: Tensor) -> Tensor:
        """Return the features: (b, n, 3), box centered at the origin, its longest side 1 -> (b, `maps`)."""
        each = self.first(2 * points.transpose(1, 2))
        whole = self.of_cloud(each.amax(dim=2)).unsqueeze(2)
        features: Tensor = self.last(nnf.relu(self.of_point(each) + whole)).amax(dim=2)
        return nnf.relu(features)
