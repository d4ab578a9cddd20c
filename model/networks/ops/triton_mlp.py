"""A hidden ReLU layer with its output layer as Triton kernels: the device's form of `fused_mlp`.

All arithmetic is float32 on the ordinary cores. With three inputs and three outputs a hidden unit is worth about
seven operations forward and twenty-five backward, too few for the matrix units to pay. Hidden units stay in
registers; each sum is kept per lane and reduced once at the end, so results do not depend on the order of programs.
"""

from typing import Any, Final

import torch
import triton
import triton.language as tl
from torch import Tensor

# Tiles (points, hidden units) that leave a program of four warps with at most 128 registers a thread.
FORWARD: Final = (64, 32)
POINT_GRADIENTS: Final = (64, 16)
WEIGHT_GRADIENTS: Final = (8, 128)


class TritonLayers(torch.autograd.Function):
    """y = V relu(W x + b) + c for every point of every object, on the device.

    `apply(w, b, v, c, x)`: W (b, 3, h) by inputs, its b (b, h), V (b, 3, h) by outputs, its c (b, 3) and
    points (b, 3, n), all contiguous float32 -> (b, 3, n). Differentiable in all five.
    """

    @staticmethod
    def forward(ctx: Any, w: Tensor, b: Tensor, v: Tensor, c: Tensor, x: Tensor) -> Tensor:  # noqa: ANN401
        """Return the points."""
        ctx.save_for_backward(w, b, v, x)
        y, (objects, _, n), h = torch.empty_like(x), x.shape, w.shape[2]
        tile, units = FORWARD
        _points[(triton.cdiv(n, tile), objects)](w, b, v, c, x, y, n, h, tile=tile, units=units)
        return y

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor | None, ...]:  # noqa: ANN401
        """Return the gradients of w, b, v, c and x; None for x where nothing needs it."""
        w, b, v, x = ctx.saved_tensors
        g = gradients[0].contiguous()
        (objects, _, n), h = x.shape, w.shape[2]
        gw, gb, gv = (torch.empty_like(each) for each in (w, b, v))
        tile, units = WEIGHT_GRADIENTS
        _weight_gradients[(triton.cdiv(h, units), objects)](w, b, v, x, g, gw, gb, gv, n, h, tile=tile, units=units)
        gx = None
        if ctx.needs_input_grad[4]:
            gx = torch.empty_like(x)
            tile, units = POINT_GRADIENTS
            _point_gradients[(triton.cdiv(n, tile), objects)](w, b, v, x, g, gx, n, h, tile=tile, units=units)
        return gw, gb, gv, g.sum(2), gx


@triton.jit
def _three(pointer, group, index, limit):  # pragma: no cover
    """Load rows 3 group to 3 group + 2 of a (3 b, limit) matrix at the columns `index`; 0 beyond the limit."""
    start, real = pointer + group * 3 * limit + index, index < limit
    first = tl.load(start, mask=real, other=0.0)
    second = tl.load(start + limit, mask=real, other=0.0)
    third = tl.load(start + 2 * limit, mask=real, other=0.0)
    return first, second, third


@triton.jit
def _store_three(pointer, group, index, limit, first, second, third):  # pragma: no cover
    """Store what `_three` loads."""
    start, real = pointer + group * 3 * limit + index, index < limit
    tl.store(start, first, mask=real)
    tl.store(start + limit, second, mask=real)
    tl.store(start + 2 * limit, third, mask=real)


@triton.jit
def _units(w, v, b, o, u, h):  # pragma: no cover
    """Load the weights of the hidden units `u` of object `o`."""
    w0, w1, w2 = _three(w, o, u, h)
    v0, v1, v2 = _three(v, o, u, h)
    bias = tl.load(b + o * h + u, mask=u < h, other=0.0)
    return w0, w1, w2, v0, v1, v2, bias


@triton.jit
def _inputs(x0, x1, x2, w0, w1, w2, bias):  # pragma: no cover
    """Return W x + b, (points, hidden units)."""
    hidden = x0[:, None] * w0[None, :] + bias[None, :]
    return x2[:, None] * w2[None, :] + (x1[:, None] * w1[None, :] + hidden)


@triton.jit
def _gradients(hidden, g0, g1, g2, v0, v1, v2):  # pragma: no cover
    """Return the gradient of W x + b, which is `hidden`: (points, hidden units)."""
    q = g0[:, None] * v0[None, :] + (g1[:, None] * v1[None, :] + g2[:, None] * v2[None, :])
    return tl.where(hidden > 0.0, q, 0.0)


@triton.jit
def _points(w, b, v, c, x, y, n, h, tile: tl.constexpr, units: tl.constexpr):  # pragma: no cover
    """Compute `tile` points of one object."""
    o = tl.program_id(1)
    p = tl.program_id(0) * tile + tl.arange(0, tile)
    x0, x1, x2 = _three(x, o, p, n)
    zero = tl.zeros((tile, units), tl.float32)
    y0, y1, y2 = zero, zero, zero
    for start in range(0, h, units):
        u = start + tl.arange(0, units)
        w0, w1, w2, v0, v1, v2, bias = _units(w, v, b, o, u, h)
        hidden = _inputs(x0, x1, x2, w0, w1, w2, bias)
        hidden = tl.maximum(hidden, 0.0)
        y0 += hidden * v0[None, :]
        y1 += hidden * v1[None, :]
        y2 += hidden * v2[None, :]
    c0, c1, c2 = tl.load(c + 3 * o), tl.load(c + 3 * o + 1), tl.load(c + 3 * o + 2)
    _store_three(y, o, p, n, tl.sum(y0, 1) + c0, tl.sum(y1, 1) + c1, tl.sum(y2, 1) + c2)


@triton.jit
def _weight_gradients(w, b, v, x, g, gw, gb, gv, n, h, tile: tl.constexpr, units: tl.constexpr):  # pragma: no cover
    """Compute the gradients of `units` hidden units of one object, over all its points."""
    o = tl.program_id(1)
    u = tl.program_id(0) * units + tl.arange(0, units)
    w0, w1, w2, v0, v1, v2, bias = _units(w, v, b, o, u, h)
    zero = tl.zeros((tile, units), tl.float32)
    r0, r1, r2, rb, s0, s1, s2 = zero, zero, zero, zero, zero, zero, zero
    for start in range(0, n, tile):
        p = start + tl.arange(0, tile)
        x0, x1, x2 = _three(x, o, p, n)
        g0, g1, g2 = _three(g, o, p, n)
        hidden = _inputs(x0, x1, x2, w0, w1, w2, bias)
        q = _gradients(hidden, g0, g1, g2, v0, v1, v2)
        hidden = tl.maximum(hidden, 0.0)
        r0, r1, r2, rb = r0 + q * x0[:, None], r1 + q * x1[:, None], r2 + q * x2[:, None], rb + q
        s0, s1, s2 = s0 + hidden * g0[:, None], s1 + hidden * g1[:, None], s2 + hidden * g2[:, None]
    tl.store(gb + o * h + u, tl.sum(rb, 0), mask=u < h)
    _store_three(gw, o, u, h, tl.sum(r0, 0), tl.sum(r1, 0), tl.sum(r2, 0))
    _store_three(gv, o, u, h, tl.sum(s0, 0), tl.sum(s1, 0), tl.sum(s2, 0))


@triton.jit
def _point_gradients(w, b, v, x, g, gx, n, h, tile: tl.constexpr, units: tl.constexpr):  # pragma: no cover
    """Compute the gradients of `tile` points of one object, over all hidden units."""
    o = tl.program_id(1)
    p = tl.program_id(0) * tile + tl.arange(0, tile)
    x0, x1, x2 = _three(x, o, p, n)
    g0, g1, g2 = _three(g, o, p, n)
    zero = tl.zeros((tile, units), tl.float32)
    d0, d1, d2 = zero, zero, zero
    for start in range(0, h, units):
        u = start + tl.arange(0, units)
        w0, w1, w2, v0, v1, v2, bias = _units(w, v, b, o, u, h)
        hidden = _inputs(x0, x1, x2, w0, w1, w2, bias)
        q = _gradients(hidden, g0, g1, g2, v0, v1, v2)
        d0, d1, d2 = d0 + q * w0[None, :], d1 + q * w1[None, :], d2 + q * w2[None, :]
    _store_three(gx, o, p, n, tl.sum(d0, 1), tl.sum(d1, 1), tl.sum(d2, 1))
