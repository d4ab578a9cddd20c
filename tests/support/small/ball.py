"""An object whose surface is known: a sphere of diameter 1 in the object frame."""

import numpy as np

from service.formats.weights import Weights, dump
from service.mapping.spec import Array, MappingSpec

SPEC = MappingSpec("ball", 3, (6,), 3, domain="sphere")
RADIUS = 0.5


def theta(center: tuple[float, float, float] = (0, 0, 0), radius: float = 1.0) -> Array:
    """Return the weights of x -> center + radius x, as relu(x) - relu(-x)."""
    halves = np.concatenate([np.eye(3), -np.eye(3)])  # (6, 3)
    parts = [halves.ravel(), np.zeros(6), radius * halves.T.ravel(), np.array(center)]
    return np.concatenate(parts).astype(np.float32)


def ball_file(center: tuple[float, float, float] = (0, 0, 0), radius: float = 1.0) -> bytes:
    """Return a weights file whose function's own numbers are a sphere around a center."""
    return dump(Weights(SPEC, theta(center, radius), "elsewhere"), "safetensors")
