"""Engines that compute points: NumPy, or the compiled kernel."""

from typing import Final

import numpy as np
import pytest

from service.mapping import compiled
from service.mapping.compiled import Kernel
from service.mapping.spec import Array, MappingSpec, initial_theta

# Building the kernel takes a C compiler: where there was none, its tests are of the tier that needs programs.
needs_kernel: Final = pytest.mark.unit if compiled.load() else pytest.mark.system


def instruction_sets() -> dict[str, int]:
    """Return the kernel's instruction sets on this processor; one that does not exist if the kernel is not built."""
    kernel = compiled.load()
    return kernel.SETS if kernel else {"none": 0}


def built_kernel() -> Kernel:
    """Return the compiled kernel. Fail without it."""
    kernel = compiled.load()
    assert kernel is not None, "the kernel is not built: run `pip install --no-deps -e .` where there is a C compiler"
    return kernel


def weights(spec: MappingSpec, seed: int) -> Array:
    """Draw a theta whose biases are not zero."""
    theta = initial_theta(spec, seed)
    return theta + np.random.default_rng(seed).normal(0, 0.05, theta.size).astype(np.float32)
