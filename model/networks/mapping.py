"""The mapping function f_theta in torch, for a batch of thetas. `service.mapping` has the NumPy reference.

With `model.networks.encoder` this is the whole model: an image becomes theta there, and theta a point cloud here.
"""

import torch
from torch import Tensor

from model.networks.ops.dispatch import fused_layers
from service.mapping.spec import MappingSpec


def power(spec: MappingSpec, theta: Tensor, x: Tensor) -> Tensor:
    """Return f_theta^k(x) for a batch (paper, eq. 4).

    Parameters
    ----------
    theta : (b, spec.size).
    x : (b, n, spec.input_dim), canonical points.

    Returns
    -------
    (b, n, 3), object frame.
    """
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
    """Return `power` of a spec with one hidden ReLU layer on three inputs."""
    (w, b), (v, c) = split_theta(spec, theta)
    layers = [w.transpose(1, 2).contiguous(), b.contiguous(), v.contiguous(), c.contiguous()]
    x = x.transpose(1, 2).contiguous()
    for _ in range(spec.k):
        x = fused_layers(x.device).apply(*layers, x)  # type: ignore[no-untyped-call]
    return x.transpose(1, 2)


def split_theta(spec: MappingSpec, theta: Tensor) -> list[tuple[Tensor, Tensor]]:
    """Return views [(W (b, out, in), b (b, out)), ...] of thetas (b, spec.size), first layer first."""
    views, start = [], 0
    for n_out, n_in in spec.shapes:
        middle, end = start + n_out * n_in, start + n_out * n_in + n_out
        views.append((theta[:, start:middle].reshape(-1, n_out, n_in), theta[:, middle:end]))
        start = end
    return views
