"""A fused, compiled layer pair for mapping networks of one hidden layer: the extra `fast` (numba).

Four points at a time run over the hidden units, which are the vector's lanes: the twelve sums of the
output stay in registers, and HOF-1's weights (28 KB) in the L1 cache. Nothing of the hidden layer is
ever stored.
"""

import functools
import importlib.util
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from service.mapping import Array, MappingSpec

TILE: Final = 512  # points of a call: what a call itself costs is lost in it
Kernel = Callable[[Array, Array, Array, Array, Array], None]


def fits(spec: MappingSpec) -> bool:
    """Whether the kernel computes this function: three inputs, one hidden layer, ReLU."""
    return spec.input_dim == 3 and len(spec.hidden) == 1 and spec.activation == "relu"


@functools.cache
def load() -> Kernel | None:
    """The compiled kernel, or None where numba is not installed; compiles once, or reads numba's cache.

    It takes W of the hidden layer by rows of inputs (3, h), its b (h,), V of the output (3, h), its b (3,)
    and points (3, n), n a multiple of 4; and overwrites the points by f of them.
    """
    if importlib.util.find_spec("numba") is None:
        return None
    import numba  # an extra; takes half a second

    _allow_full_vectors(numba)
    options: dict[str, Any] = {
        "fastmath": True,  # sums in any order, as vectors need
        "nogil": True,
        "error_model": "numpy",
    }
    try:
        kernel = numba.njit(cache=True, **options)(_layers)
    except RuntimeError:  # no folder to write a cache to
        kernel = numba.njit(**options)(_layers)
    kernel(*(np.zeros(shape, np.float32) for shape in ((3, 16), (16,), (3, 16), (3,), (3, 4))))
    compiled: Kernel = kernel
    return compiled


def _allow_full_vectors(numba: Any) -> None:  # noqa: ANN401
    """Use AVX-512 at its full width, which LLVM by default leaves alone: nearly twice as fast."""
    import llvmlite.binding as llvm

    features = llvm.get_host_cpu_features()
    if features.get("avx512f") and not numba.config.CPU_FEATURES:
        numba.config.CPU_FEATURES = features.flatten() + ",-prefer-256-bit"


def _layers(w: Array, b: Array, v: Array, c: Array, x: Array) -> None:  # pragma: no cover - compiled
    w0, w1, w2 = w[0], w[1], w[2]
    v0, v1, v2 = v[0], v[1], v[2]
    zero = np.float32(0)
    for p in range(0, x.shape[1], 4):
        q, r, s = p + 1, p + 2, p + 3
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
        x[0, p], x[1, p], x[2, p] = p0 + c[0], p1 + c[1], p2 + c[2]
        x[0, q], x[1, q], x[2, q] = q0 + c[0], q1 + c[1], q2 + c[2]
        x[0, r], x[1, r], x[2, r] = r0 + c[0], r1 + c[1], r2 + c[2]
        x[0, s], x[1, s], x[2, s] = s0 + c[0], s1 + c[1], s2 + c[2]
