"""A hidden layer with its output layer as one compiled operation, forward and backward.

For HOF-1 a batch's hidden units are 100 MB that a plain implementation writes and reads several times a
step. Here the backward pass computes them again and nothing is stored: about seven times faster.
"""

from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final

import numba
import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

TILE: Final = 512  # points: their coordinates and gradients stay in the L1 cache
Array = npt.NDArray[np.float32]

_compiled = numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")


class FusedLayers(torch.autograd.Function):
    """y = V relu(W x + b) + c for every point of every object.

    `apply(w, b, v, c, x)`: W (b, 3, h) by inputs, its b (b, h), V (b, 3, h) by outputs, its c (b, 3) and
    points (b, 3, n), all contiguous -> (b, 3, n). Differentiable in all five.
    """

    @staticmethod
    def forward(ctx: Any, w: Tensor, b: Tensor, v: Tensor, c: Tensor, x: Tensor) -> Tensor:  # noqa: ANN401
        """Return the points."""
        ctx.save_for_backward(w, b, v, x)
        y = c.unsqueeze(2).expand_as(x).contiguous()
        _for_all(_forward, w, b, v, x, y)
        return y

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, ...]:  # noqa: ANN401
        """Return the gradients of w, b, v, c and x."""
        w, b, v, x = ctx.saved_tensors
        g = gradients[0].contiguous()
        gw, gb, gv, gx = (torch.zeros_like(each) for each in (w, b, v, x))
        _for_all(_backward, w, b, v, x, g, gw, gb, gv, gx)
        return gw, gb, gv, g.sum(2), gx


def _for_all(kernel: Any, *tensors: Tensor) -> None:  # noqa: ANN401
    """Run a kernel on every object, in as many threads as torch uses."""
    arrays = [tensor.detach().numpy() for tensor in tensors]
    with ThreadPoolExecutor(torch.get_num_threads()) as threads:
        list(threads.map(kernel, *arrays))


@_compiled  # type: ignore[untyped-decorator]
def _forward(w: Array, b: Array, v: Array, x: Array, y: Array) -> None:  # pragma: no cover - compiled
    zero = x.dtype.type(0)
    for start in range(0, x.shape[1], TILE):
        x0, x1, x2 = x[0, start : start + TILE], x[1, start : start + TILE], x[2, start : start + TILE]
        y0, y1, y2 = y[0, start : start + TILE], y[1, start : start + TILE], y[2, start : start + TILE]
        for u in range(b.size):
            w0, w1, w2, b0 = w[0, u], w[1, u], w[2, u], b[u]
            v0, v1, v2 = v[0, u], v[1, u], v[2, u]
            for p in range(x0.size):
                h = max(w0 * x0[p] + w1 * x1[p] + w2 * x2[p] + b0, zero)
                y0[p] += v0 * h
                y1[p] += v1 * h
                y2[p] += v2 * h


@_compiled  # type: ignore[untyped-decorator]
def _backward(
    w: Array, b: Array, v: Array, x: Array, g: Array, gw: Array, gb: Array, gv: Array, gx: Array
) -> None:  # pragma: no cover - compiled
    zero = x.dtype.type(0)
    for start in range(0, x.shape[1], TILE):
        x0, x1, x2 = x[0, start : start + TILE], x[1, start : start + TILE], x[2, start : start + TILE]
        g0, g1, g2 = g[0, start : start + TILE], g[1, start : start + TILE], g[2, start : start + TILE]
        d0, d1, d2 = gx[0, start : start + TILE], gx[1, start : start + TILE], gx[2, start : start + TILE]
        for u in range(b.size):
            w0, w1, w2, b0 = w[0, u], w[1, u], w[2, u], b[u]
            v0, v1, v2 = v[0, u], v[1, u], v[2, u]
            r0 = r1 = r2 = rb = s0 = s1 = s2 = zero
            for p in range(x0.size):
                h = w0 * x0[p] + w1 * x1[p] + w2 * x2[p] + b0
                q = v0 * g0[p] + v1 * g1[p] + v2 * g2[p]  # the gradient of relu(h)
                q = q if h > zero else zero
                h = max(h, zero)
                r0, r1, r2, rb = r0 + q * x0[p], r1 + q * x1[p], r2 + q * x2[p], rb + q
                s0, s1, s2 = s0 + h * g0[p], s1 + h * g1[p], s2 + h * g2[p]
                d0[p] += w0 * q
                d1[p] += w1 * q
                d2[p] += w2 * q
            gw[0, u] += r0
            gw[1, u] += r1
            gw[2, u] += r2
            gb[u] += rb
            gv[0, u] += s0
            gv[1, u] += s1
            gv[2, u] += s2
