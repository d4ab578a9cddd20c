"""Nearest points and the fused hidden layer in plain torch: on any device, without a compiler.

The reference for the Triton and Numba kernels, and the fallback if neither is installed.
"""

from typing import Any, Final

import torch
from torch import Tensor

PAIRS: Final = 1 << 26  # query-target pairs, or hidden units, computed at once: 256 MB


def nearest_index(queries: Tensor, targets: Tensor) -> Tensor:
    """Index of each query's nearest target, per batch element: (b, n, 3), (b, m, 3) -> (b, n) int64."""
    queries, targets = queries.detach(), targets.detach()
    half = 0.5 * targets.square().sum(2).unsqueeze(1)  # (b, 1, m)
    across = targets.transpose(1, 2)
    parts = torch.split(queries, _rows(len(queries), targets.shape[1]), dim=1)
    return torch.cat([torch.baddbmm(half, part, across, alpha=-1).argmin(2) for part in parts], dim=1)


class RecomputedLayers(torch.autograd.Function):
    """y = V relu(W x + b) + c for every point of every object; hidden units are computed again, not stored.

    `apply(w, b, v, c, x)`: W (b, 3, h) by inputs, its b (b, h), V (b, 3, h) by outputs, its c (b, 3) and
    points (b, 3, n) -> (b, 3, n). Differentiable in all five.
    """

    @staticmethod
    def forward(ctx: Any, w: Tensor, b: Tensor, v: Tensor, c: Tensor, x: Tensor) -> Tensor:  # noqa: ANN401
        """Return the points."""
        ctx.save_for_backward(w, b, v, x)
        hidden = (_hidden(w, b, part).relu_() for part in torch.split(x, _rows(*b.shape), dim=2))
        return torch.cat([torch.baddbmm(c.unsqueeze(2), v, part) for part in hidden], dim=2)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, ...]:  # noqa: ANN401
        """Return the gradients of w, b, v, c and x."""
        w, b, v, x = ctx.saved_tensors
        g = gradients[0]
        gw, gb, gv, gx = torch.zeros_like(w), torch.zeros_like(b), torch.zeros_like(v), []
        rows = _rows(*b.shape)
        for points, gradient in zip(torch.split(x, rows, dim=2), torch.split(g, rows, dim=2), strict=True):
            hidden = _hidden(w, b, points)
            slope = torch.bmm(v.transpose(1, 2), gradient).masked_fill_(hidden <= 0, 0)  # (b, h, n)
            gw += torch.bmm(points, slope.transpose(1, 2))
            gb += slope.sum(2)
            gv += torch.bmm(gradient, hidden.relu_().transpose(1, 2))
            gx.append(torch.bmm(w, slope))
        return gw, gb, gv, g.sum(2), torch.cat(gx, dim=2)


def _hidden(w: Tensor, b: Tensor, x: Tensor) -> Tensor:
    """Return W x + b: (b, 3, h), (b, h), (b, 3, n) -> (b, h, n)."""
    return torch.baddbmm(b.unsqueeze(2), w.transpose(1, 2), x)


def _rows(objects: int, columns: int) -> int:
    """Return how many rows of `columns` numbers an object may have at once."""
    return max(1, PAIRS // (objects * columns))
