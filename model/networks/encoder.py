"""The image encoder g_phi and the torch twin of the mapping function f_theta."""

from typing import Final

import torch
from torch import Tensor, nn

from model.config import EncoderConfig
from model.networks.ops import fused_mlp
from model.networks.trunk import ImageTrunk
from service.mapping.spec import MappingSpec, initial_theta

HEAD_SCALE: Final = 0.2  # of theta_0: how far objects differ at the start; exactly zero stalls


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
        x = fused_mlp.FusedLayers.apply(*layers, x)  # type: ignore[no-untyped-call]
    return x.transpose(1, 2)


def split_theta(spec: MappingSpec, theta: Tensor) -> list[tuple[Tensor, Tensor]]:
    """Views [(W (b, out, in), b (b, out)), ...] of a batch of thetas (b, size), first layer first."""
    views, start = [], 0
    for n_out, n_in in spec.shapes:
        middle, end = start + n_out * n_in, start + n_out * n_in + n_out
        views.append((theta[:, start:middle].reshape(-1, n_out, n_in), theta[:, middle:end]))
        start = end
    return views
