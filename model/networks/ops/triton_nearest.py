"""The nearest point of a cloud as a Triton kernel: the device's form of `nearest`.

Each program owns a tile of queries and walks over all targets. A lane keeps the best of the targets that it saw; the
lanes are compared once at the end, so a pair costs three multiplications and a comparison.
"""

from typing import Final

import torch
import triton
import triton.language as tl
from torch import Tensor

QUERIES: Final = 64  # rows of a tile
TARGETS: Final = 32  # columns of a tile; more would need over 128 registers a thread
FAR: Final = tl.constexpr(1e30)


def nearest_index(queries: Tensor, targets: Tensor) -> Tensor:
    """Index of each query's nearest target, per batch element: (b, n, 3), (b, m, 3) float32 -> (b, n) int64."""
    (b, n, _), m = queries.shape, targets.shape[1]
    index = torch.empty((b, n), dtype=torch.int64, device=queries.device)
    grid = (triton.cdiv(n, QUERIES), b)
    _nearest[grid](
        queries.detach().contiguous(), targets.detach().contiguous(), index, n, m, rows=QUERIES, columns=TARGETS
    )
    return index


@triton.jit
def _nearest(queries, targets, index, n, m, rows: tl.constexpr, columns: tl.constexpr):  # pragma: no cover
    """Find the targets of `rows` queries: those of the smallest |t|^2 / 2 - q t, half of |q - t|^2 - |q|^2."""
    o = tl.program_id(1)
    q = tl.program_id(0) * rows + tl.arange(0, rows)
    lane = tl.arange(0, columns)
    start = queries + (o * n + q) * 3
    x = -tl.load(start, mask=q < n, other=0.0)
    y = -tl.load(start + 1, mask=q < n, other=0.0)
    z = -tl.load(start + 2, mask=q < n, other=0.0)
    best = tl.full((rows, columns), FAR, tl.float32)
    tile = tl.zeros((rows, columns), tl.int32)
    for first in range(0, m, columns):
        real = first + lane < m
        target = targets + (o * m + first + lane) * 3
        u = tl.load(target, mask=real, other=0.0)
        v = tl.load(target + 1, mask=real, other=0.0)
        w = tl.load(target + 2, mask=real, other=0.0)
        half = tl.where(real, 0.5 * (u * u + v * v + w * w), FAR)
        distance = x[:, None] * u[None, :] + (y[:, None] * v[None, :] + (z[:, None] * w[None, :] + half[None, :]))
        nearer = distance < best
        best = tl.where(nearer, distance, best)
        tile = tl.where(nearer, first, tile)
    lowest = tl.min(best, 1)
    candidates = tl.where(best == lowest[:, None], tile + lane[None, :], m)
    tl.store(index + o * n + q, tl.min(candidates, 1), mask=q < n)
