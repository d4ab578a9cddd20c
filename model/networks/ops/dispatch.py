"""The fastest form of each operation on a device: compiled for the CPU, Triton on CUDA, plain torch without either.

Compilers are imported at the first call: a machine that trains on a GPU needs no Numba, and one without needs no
Triton.
"""

import functools
from collections.abc import Callable
from importlib.util import find_spec

import torch
from torch import Tensor

from model.networks.ops import plain

Nearest = Callable[[Tensor, Tensor], Tensor]


def nearest_index(queries: Tensor, targets: Tensor) -> Tensor:
    """Return the index of each query's nearest target, per batch element: (b, n, 3), (b, m, 3) -> (b, n) int64."""
    return _nearest(queries.device.type)(queries, targets)


def fused_layers(device: torch.device) -> type[torch.autograd.Function]:
    """Return the hidden ReLU layer with its output layer, as in `plain.RecomputedLayers`, for tensors on a device."""
    if device.type == "cuda" and _has("triton"):
        from model.networks.ops.triton_mlp import TritonLayers

        return TritonLayers
    if device.type == "cpu" and _has("numba"):
        from model.networks.ops.fused_mlp import FusedLayers

        return FusedLayers
    return plain.RecomputedLayers


def _nearest(device: str) -> Nearest:
    if device == "cuda" and _has("triton"):
        from model.networks.ops import triton_nearest

        return triton_nearest.nearest_index
    if device == "cpu" and _has("numba"):
        from model.networks.ops import nearest as compiled

        return compiled.nearest_index
    return plain.nearest_index


@functools.cache
def _has(package: str) -> bool:
    return find_spec(package) is not None
