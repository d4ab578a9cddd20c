"""Fit an object to the points that it was completed from: a few steps of gradient descent on theta.

The encoder's object is right as a whole and rough in detail. Each step pulls the object's points toward those that were
sent, and holds all of them near where the encoder had them; so what was not seen stays. The optimizer is Adam, its
steps being in units of each layer's own initialization, as in training.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from service.mapping.canonical import canonical_points
from service.mapping.spec import Array, MappingSpec, initial_theta, layers, power

STEPS: Final = 80
RATE: Final = 0.05  # of the first step; it falls linearly to a twentieth
HOLD: Final = 1.0  # weight of the squared distance to where the encoder had a point, beside the distance to the part
OBJECT_POINTS: Final = 512
PART_POINTS: Final = 512
DECAYS: Final = (0.9, 0.999)  # Adam's, of the means of the gradient and of its square
TINY: Final = 1e-8

Layers = list[tuple[Array, Array]]


def refine(spec: MappingSpec, theta: Array, part: Array, steps: int = STEPS) -> Array:
    """Return theta, (spec.size,) float32, fitted to points (n, 3), in random order, of the function's own numbers."""
    canonical, part = canonical_points(spec.domain, OBJECT_POINTS), part[:PART_POINTS]
    held, spread = power(spec, theta, canonical), _spread(spec)
    mean, square, fitted = np.zeros_like(theta), np.zeros_like(theta), theta.copy()
    for step in range(1, steps + 1):
        gradient = spread * _gradient(spec, fitted, canonical, held, part)
        mean += (1 - DECAYS[0]) * (gradient - mean)
        square += (1 - DECAYS[1]) * (gradient**2 - square)
        size = (square / (1 - DECAYS[1] ** step)) ** 0.5 + TINY
        rate = RATE * (1.05 - step / steps)
        fitted -= spread * np.float32(rate / (1 - DECAYS[0] ** step)) * mean / size
    return fitted


def _gradient(spec: MappingSpec, theta: Array, canonical: Array, held: Array, part: Array) -> Array:
    """Return the gradient of the loss by theta, (spec.size,)."""
    weights, gradient = layers(spec, theta), np.zeros_like(theta)
    traces = [_forward(spec, weights, canonical)]
    for _ in range(spec.k - 1):
        traces.append(_forward(spec, weights, traces[-1][-1]))
    slope = _slope(traces[-1][-1], held, part)
    for trace in reversed(traces):
        slope = _backward(spec, weights, trace, slope, layers(spec, gradient))
    return gradient


def _slope(points: Array, held: Array, part: Array) -> Array:
    """Return the gradient of the loss by the object's points, (n, 3)."""
    slope = (points - held) * np.float32(2 * HOLD / len(points))
    squared = (points**2).sum(axis=1)[:, None] - 2 * points @ part.T  # but for a term of each point of the part
    nearest = squared.argmin(axis=0)
    away = points[nearest] - part
    np.add.at(slope, nearest, away / (np.linalg.norm(away, axis=1, keepdims=True) + TINY) / np.float32(len(part)))
    return slope


def _forward(spec: MappingSpec, weights: Layers, x: Array) -> list[Array]:
    """Return the values of one application of the function: its inputs, each hidden layer's, its outputs."""
    trace = [x]
    for number, (w, b) in enumerate(weights):
        x = x @ w.T
        x += b
        if number < len(weights) - 1:
            np.maximum(x, 0, out=x) if spec.activation == "relu" else np.tanh(x, out=x)
        trace.append(x)
    return trace


def _backward(spec: MappingSpec, weights: Layers, trace: Sequence[Array], slope: Array, gradient: Layers) -> Array:
    """Add the gradient by the weights of one application; return that by its inputs."""
    for number in reversed(range(len(weights))):
        (w, _), (w_slope, b_slope) = weights[number], gradient[number]
        if number < len(weights) - 1:
            slope *= trace[number + 1] > 0 if spec.activation == "relu" else 1 - trace[number + 1] ** 2
        w_slope += slope.T @ trace[number]
        b_slope += slope.sum(axis=0)
        slope = slope @ w
    return slope


def _spread(spec: MappingSpec) -> Array:
    """Return the spread of each layer's initial weights, for each number of theta."""
    spread = initial_theta(spec)
    for w, b in layers(spec, spread):
        w[...] = b[...] = np.concatenate([w.ravel(), b]).std()
    return spread
