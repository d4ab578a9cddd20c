"""Kernels compiled by numba, which the extra `fast` installs: Philox's random numbers, and folded networks.

Four points of a cell at a time run over the cell's hidden units, which are the lanes of a vector. The twelve sums
of the output stay in registers, and the hidden layer is never stored.
"""

import functools
import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

LANES: Final = 16  # a cell's units are padded with zeros to whole vectors
STEPS: Final = 256  # steps of Philox at a time: its words stay in the L1 cache

Array = npt.NDArray[np.float32]
Mask = npt.NDArray[np.bool_]
Order = npt.NDArray[np.int32]
Starts = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Compiled:
    """The compiled functions. They run without Python's lock, and write results to their last arguments.

    uniform : (key, counter, u (4, n)), n even: n / 2 steps of Philox 4x64-10 after `counter`, as numbers in [0, 1).
    pack : (crossing (cells, h), units (7, h), starts (cells + 1,), packed (7, starts[-1])): each cell's units.
    sort : (x (3, n), origin, per_unit, grid, order (n,), ends (cells,)): indices of the points in the order of their
        cells, and the end of each cell's points in that order.
    evaluate : (x (3, n), order, ends, starts, packed, affine, y (3, n)): the function's values.
    """

    uniform: Callable[[np.uint64, int, Array], None]
    pack: Callable[[Mask, Array, Starts, Array], None]
    sort: Callable[[Array, Array, Array, int, Order, Starts], None]
    evaluate: Callable[[Array, Order, Starts, Starts, Array, Array, Array], None]


@functools.cache
def load() -> Compiled | None:
    """Return the compiled functions, or None without numba; compile once, or read numba's cache."""
    if importlib.util.find_spec("numba") is None:
        return None
    import numba  # optional, and its import takes half a second

    _allow_full_vectors(numba)
    sums = {"reassoc", "contract", "nsz"}  # sums in any order, as vectors need; infinities and NaN are kept
    compiled = Compiled(
        _compile(numba, _uniform),
        _compile(numba, _pack),
        _compile(numba, _sort),
        _compile(numba, _evaluate, fastmath=sums),
    )
    _compile_now(compiled)
    return compiled


def _compile_now(compiled: Compiled) -> None:
    """Call each function once, so that it is compiled at start and not in the first request."""
    compiled.uniform(np.uint64(0), 0, np.zeros((4, 2), np.float32))
    starts, units = np.array([0, LANES]), np.zeros((7, LANES), np.float32)
    compiled.pack(np.ones((1, LANES), np.bool_), units, starts, units)
    x, ones, order, ends = units[:3, :1].copy(), np.ones(3, np.float32), np.zeros(1, np.int32), np.zeros(1, np.int64)
    compiled.sort(x, ones, ones, 0, order, ends)
    compiled.evaluate(x, order, ends, starts, units, np.zeros((1, 3, 4), np.float32), x.copy())


def _compile(numba: Any, function: Callable[..., None], **options: set[str]) -> Callable[..., None]:  # noqa: ANN401
    try:
        compiled: Callable[..., None] = numba.njit(cache=True, nogil=True, error_model="numpy", **options)(function)
    except RuntimeError:  # no folder to write a cache to
        compiled = numba.njit(nogil=True, error_model="numpy", **options)(function)
    return compiled


def _allow_full_vectors(numba: Any) -> None:  # noqa: ANN401
    """Let LLVM use AVX-512 at its full width, which by default it does not: nearly twice as fast."""
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features()
    if features.get("avx512f") and not numba.config.CPU_FEATURES:
        numba.config.CPU_FEATURES = features.flatten() + ",-prefer-256-bit"


def _uniform(key: np.uint64, counter: int, u: Array) -> None:  # pragma: no cover - compiled
    # Salmon et al., "Parallel random numbers: as easy as 1, 2, 3" (2011). Products of 64 by 64 bits are built from
    # 32-bit halves, since vectors have no wider product. Two of a step's four words give a point: a number per half.
    half, low, eight, unit = np.uint64(32), np.uint64(0xFFFFFFFF), np.uint64(8), np.float32(2**-24)
    a, b = np.uint64(0xD2E7470EE14C6C93), np.uint64(0xCA5A826395121157)
    a0, a1, b0, b1 = a & low, a >> half, b & low, b >> half
    c = np.empty((4, STEPS), np.uint64)
    for start in range(0, u.shape[1] // 2, STEPS):
        for i in range(STEPS):
            c[0, i] = np.uint64(counter + start) + np.uint64(i) + np.uint64(1)
            c[1, i] = c[2, i] = c[3, i] = np.uint64(0)
        k0, k1 = key, np.uint64(0)
        for _ in range(10):
            for i in range(STEPS):
                x0, x1, y0, y1 = c[0, i] & low, c[0, i] >> half, c[2, i] & low, c[2, i] >> half
                middle = a1 * x0 + (a0 * x0 >> half)
                high_a = a1 * x1 + (middle >> half) + ((a0 * x1 + (middle & low)) >> half)
                middle = b1 * y0 + (b0 * y0 >> half)
                high_b = b1 * y1 + (middle >> half) + ((b0 * y1 + (middle & low)) >> half)
                low_a, low_b = a * c[0, i], b * c[2, i]
                c[0, i], c[1, i], c[2, i], c[3, i] = high_b ^ c[1, i] ^ k0, low_b, high_a ^ c[3, i] ^ k1, low_a
            k0, k1 = k0 + np.uint64(0x9E3779B97F4A7C15), k1 + np.uint64(0xBB67AE8584CAA73B)
        for point in range(2):
            for i in range(min(STEPS, u.shape[1] // 2 - start)):
                x, y, to = c[2 * point, i], c[2 * point + 1, i], 2 * (start + i) + point
                u[0, to], u[1, to] = np.float32((x & low) >> eight) * unit, np.float32(x >> half >> eight) * unit
                u[2, to], u[3, to] = np.float32((y & low) >> eight) * unit, np.float32(y >> half >> eight) * unit


def _pack(crossing: Mask, units: Array, starts: Starts, packed: Array) -> None:  # pragma: no cover - compiled
    chosen = np.empty(crossing.shape[1], np.int64)
    for cell in range(crossing.shape[0]):
        count = 0
        for unit in range(crossing.shape[1]):
            chosen[count] = unit  # branch-free: overwritten next if the unit does not cross
            count += crossing[cell, unit]
        for row in range(7):
            for i in range(count):
                packed[row, starts[cell] + i] = units[row, chosen[i]]


def _sort(
    x: Array, origin: Array, per_unit: Array, grid: int, order: Order, ends: Starts
) -> None:  # pragma: no cover - compiled
    zero, edge, side, outside = np.float32(0), np.float32(grid), np.int32(grid), np.int32(grid**3)
    cells = np.empty(x.shape[1], np.int32)
    for i in range(x.shape[1]):
        a, b, c = x[0, i] - origin[0], x[1, i] - origin[1], x[2, i] - origin[2]
        a, b, c = a * per_unit[0], b * per_unit[1], c * per_unit[2]
        inside = (a >= zero) & (a < edge) & (b >= zero) & (b < edge) & (c >= zero) & (c < edge)  # false for NaN
        cells[i] = (np.int32(a) * side + np.int32(b)) * side + np.int32(c) if inside else outside
    ends[:] = 0
    for cell in cells:  # a counting sort
        ends[cell] += 1
    begin = 0
    for place in range(len(ends)):
        count = ends[place]
        ends[place] = begin
        begin += count
    for i in range(len(cells)):
        order[ends[cells[i]]] = i
        ends[cells[i]] += 1


def _evaluate(
    x: Array, order: Order, ends: Starts, starts: Starts, units: Array, affine: Array, y: Array
) -> None:  # pragma: no cover - compiled
    zero, begin = np.float32(0), 0
    for cell in range(len(ends)):
        end, t = ends[cell], affine[cell]
        low, high = starts[cell], starts[cell + 1]
        w0, w1, w2, b = units[0, low:high], units[1, low:high], units[2, low:high], units[3, low:high]
        v0, v1, v2 = units[4, low:high], units[5, low:high], units[6, low:high]
        for at in range(begin, end, 4):
            p, q = order[at], order[min(at + 1, end - 1)]
            r, s = order[min(at + 2, end - 1)], order[min(at + 3, end - 1)]
            xp, yp, zp = x[0, p], x[1, p], x[2, p]
            xq, yq, zq = x[0, q], x[1, q], x[2, q]
            xr, yr, zr = x[0, r], x[1, r], x[2, r]
            xs, ys, zs = x[0, s], x[1, s], x[2, s]
            p0 = p1 = p2 = q0 = q1 = q2 = r0 = r1 = r2 = s0 = s1 = s2 = zero
            for h in range(b.shape[0]):
                up = max(w0[h] * xp + w1[h] * yp + w2[h] * zp + b[h], zero)
                uq = max(w0[h] * xq + w1[h] * yq + w2[h] * zq + b[h], zero)
                ur = max(w0[h] * xr + w1[h] * yr + w2[h] * zr + b[h], zero)
                us = max(w0[h] * xs + w1[h] * ys + w2[h] * zs + b[h], zero)
                p0, p1, p2 = p0 + v0[h] * up, p1 + v1[h] * up, p2 + v2[h] * up
                q0, q1, q2 = q0 + v0[h] * uq, q1 + v1[h] * uq, q2 + v2[h] * uq
                r0, r1, r2 = r0 + v0[h] * ur, r1 + v1[h] * ur, r2 + v2[h] * ur
                s0, s1, s2 = s0 + v0[h] * us, s1 + v1[h] * us, s2 + v2[h] * us
            for d, (fp, fq, fr, fs) in enumerate(((p0, q0, r0, s0), (p1, q1, r1, s1), (p2, q2, r2, s2))):
                y[d, s] = fs + t[d, 0] * xs + t[d, 1] * ys + t[d, 2] * zs + t[d, 3]
                y[d, r] = fr + t[d, 0] * xr + t[d, 1] * yr + t[d, 2] * zr + t[d, 3]
                y[d, q] = fq + t[d, 0] * xq + t[d, 1] * yq + t[d, 2] * zq + t[d, 3]
                y[d, p] = fp + t[d, 0] * xp + t[d, 1] * yp + t[d, 2] * zp + t[d, 3]
        begin = end
