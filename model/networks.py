"""The image encoder g_phi and the torch twin of the mapping function f_theta."""

from typing import Final

import torch
from torch import Tensor, nn

from model import fused
from model.config import EncoderConfig
from service.mapping import MappingSpec, initial_theta

HEAD_SCALE: Final = 0.2  # of theta_0: how far objects differ at the start; exactly zero stalls
HALF: Final = bool(torch.cpu.get_capabilities().get("amx_bf16"))  # this CPU multiplies bfloat16 matrices faster


class DenseBlock(nn.Module):
    """`convolutions` 3x3 convolutions, each seeing all maps before it and adding `growth`."""

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
        """(b, maps, h, w) -> (b, maps + convolutions * growth, h, w)."""
        for layer in self.layers:
            x = torch.cat([x, layer(x)], dim=1)
        return x


class ImageTrunk(nn.Module):
    """What every method shares: an RGB image -> features (paper, appendix: baseline encoder).

    `width` is how many features there are: the rank, or without one the last fully connected layer. In
    training the trunk computes in bfloat16 where the CPU gains by it; in evaluation always in float32.
    """

    def __init__(self, config: EncoderConfig, size: int) -> None:
        super().__init__()
        blocks: list[nn.Module] = [nn.Conv2d(3, config.feature_maps[0], 3, stride=2, padding=1, bias=False)]
        maps = config.feature_maps[0]
        for growth in config.feature_maps:
            blocks.append(DenseBlock(maps, growth, config.convolutions))
            grown = maps + config.convolutions * growth
            maps = grown // 2
            blocks += [nn.BatchNorm2d(grown), nn.ReLU(), nn.Conv2d(grown, maps, 1, bias=False), nn.AvgPool2d(2)]
        self.features = nn.Sequential(*blocks)
        side = size // 2 ** (1 + len(config.feature_maps))
        width = maps * side * side
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
        """(b, 3, size, size) in [0, 1] -> (b, width)."""
        return self.look(image)[1]

    def look(self, image: Tensor) -> tuple[Tensor, Tensor]:
        """The last feature maps (b, maps, side, side) of images (b, 3, size, size), and their features (b, width)."""
        with torch.autocast("cpu", torch.bfloat16, enabled=HALF and self.training):
            maps: Tensor = self.features(2 * image - 1)
            features: Tensor = self.dense(maps.flatten(1))
        return maps.float(), features.float()


class ImageEncoder(ImageTrunk):
    """g_phi: an RGB image -> theta (paper, eq. 1).

    The last layer starts as theta_0, one ordinary initialisation of f, plus small weights, so that
    every object starts as the same sane function.
    """

    def __init__(self, spec: MappingSpec, config: EncoderConfig, size: int) -> None:
        super().__init__(config, size)
        self.head = ThetaHead(spec, self.width)

    def forward(self, image: Tensor) -> Tensor:
        """(b, 3, size, size) in [0, 1] -> (b, spec.size)."""
        theta: Tensor = self.head(super().forward(image))
        return theta


class ThetaHead(nn.Module):
    """theta = theta_0 + scale * (W h + b), scale being the spread of each layer's own initialisation.

    With it one step of Adam moves every layer of f by the same share of its size; without it the first
    steps blow f up, since the 1,024 hidden units of HOF-1 move together.
    """

    theta_0: Tensor
    scale: Tensor

    def __init__(self, spec: MappingSpec, width: int) -> None:
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

    def forward(self, x: Tensor) -> Tensor:
        """(b, width) -> (b, spec.size)."""
        theta: Tensor = self.theta_0 + self.scale * self.linear(x)
        return theta


def power(spec: MappingSpec, theta: Tensor, x: Tensor) -> Tensor:
    """f_theta^k(x) for a batch (paper, eq. 4): (b, size), (b, n, input_dim) -> (b, n, 3)."""
    if spec.is_one_relu_layer:
        return _fused_power(spec, theta, x)
    *hidden, (w_last, b_last) = split_theta(spec, theta)
    folded = [torch.cat([w, b.unsqueeze(2)], dim=2).transpose(1, 2) for w, b in hidden]  # bias as one more input
    ones = x.new_ones(1, 1, 1).expand(x.shape[0], x.shape[1], 1)
    for _ in range(spec.k):
        for w in folded:
            x = torch.bmm(torch.cat([x, ones], dim=2), w)  # (b, n, out)
            x = x.relu_() if spec.activation == "relu" else x.tanh_()
        x = torch.baddbmm(b_last.unsqueeze(1), x, w_last.transpose(1, 2))
    return x


def _fused_power(spec: MappingSpec, theta: Tensor, x: Tensor) -> Tensor:
    """`power` of a spec with one hidden layer."""
    (w, b), (v, c) = split_theta(spec, theta)
    layers = [w.transpose(1, 2).contiguous(), b.contiguous(), v.contiguous(), c.contiguous()]
    x = x.transpose(1, 2).contiguous()
    for _ in range(spec.k):
        x = fused.FusedLayers.apply(*layers, x)  # type: ignore[no-untyped-call]
    return x.transpose(1, 2)


def split_theta(spec: MappingSpec, theta: Tensor) -> list[tuple[Tensor, Tensor]]:
    """Views [(W (b, out, in), b (b, out)), ...] of a batch of thetas (b, size), first layer first."""
    views, start = [], 0
    for n_out, n_in in spec.shapes:
        middle, end = start + n_out * n_in, start + n_out * n_in + n_out
        views.append((theta[:, start:middle].reshape(-1, n_out, n_in), theta[:, middle:end]))
        start = end
    return views
