"""float16 weights whose function stays close: rounding errors of the last layer are made to cancel each other.

Each weight is rounded to the nearest number. Then, one after the other, the weight of each output whose error would
help most takes its other neighbor, so that the outputs at some points come closer to the exact ones. Points of the
shipped models' objects then move half as far as with plain rounding.
"""

from dataclasses import replace
from typing import Final, Literal, TypeVar

import numpy as np
import numpy.typing as npt

from service.errors import InvalidParameter
from service.formats.precision import probe_points, to_float16
from service.mapping.canonical import canonical_points
from service.mapping.spec import Array, Functions, MappingSpec, apply, layers

POINTS: Final = 192  # of each of the k applications
PASSES: Final = 20  # at most one weight of each output a pass

LARGEST_LOSS: Final = 1e-3  # of an object that is stored as float16: movement of a point, in longest sides

StoreDtype = Literal["float32", "float16"]  # of new objects in a database
F = TypeVar("F", bound=Functions)
Halves = npt.NDArray[np.float16]


def close_float16(spec: MappingSpec, weights: Array) -> Halves:
    """Round one function (spec.size,), or each row of a word (k, spec.size), to float16.

    What is float16 already stays as it is.

    Raises
    ------
    InvalidParameter : a number is beyond float16's range.
    """
    halves = to_float16(weights)
    if weights.ndim == 1:
        return _closer(spec, weights, halves)
    return np.stack([_closer(spec, *row) for row in zip(weights, halves, strict=True)])


def rounded(spec: MappingSpec, functions: F, dtype: StoreDtype) -> F:
    """Return functions whose numbers are float16's, in float32 arrays; with `float32`, the functions themselves.

    They stay as they are if one of `LOSS_POINTS` points would move by more than `LARGEST_LOSS`, or if a number is
    beyond float16's range.

    Parameters
    ----------
    functions : those of one object, not of a word.
    """
    if dtype == "float32":
        return functions
    try:
        theta = close_float16(spec, functions.theta).astype(np.float32)
        color = functions.color
        if color:
            color = replace(color, weights=close_float16(color.spec, color.weights).astype(np.float32))
    except InvalidParameter:
        return functions
    exact, moved = (probe_points(spec, each) for each in (functions.theta, theta))
    side = np.ptp(exact, axis=0).max()  # at most the object's
    is_close = np.linalg.norm(moved - exact, axis=1).max() <= LARGEST_LOSS * side
    return replace(functions, theta=theta, color=color) if is_close else functions


def _closer(spec: MappingSpec, theta: Array, halves: Halves) -> Halves:
    """Return float16 numbers next to theta, chosen so that the function stays close."""
    with np.errstate(over="ignore", invalid="ignore"):  # of numbers that no function needs: then nothing is changed
        x = _inputs(spec, theta)
        exact = apply(spec, theta, x)  # (n, out)
        theta_now = halves.astype(np.float32)
        h = _last_inputs(spec, theta_now, x)  # (n, hidden + 1)
        now, other = _last_layer(spec, theta_now), _last_layer(spec, _other_neighbors(theta, halves))
        delta = np.where(np.isfinite(other), other - now, 0)  # (out, hidden + 1)
        error = (h @ now.T - exact).T  # (out, n)
        squares, outputs = (h * h).sum(axis=0), np.arange(len(now))
        for _ in range(PASSES):
            gain = delta * (2 * (error @ h) + delta * squares)  # change of the squared error
            best = gain.argmin(axis=1)
            step = np.where(gain[outputs, best] < 0, delta[outputs, best], 0)
            if not step.any():
                break
            error += step[:, None] * h[:, best].T
            now[outputs, best] += step
            delta[outputs, best] -= 2 * step
    n_out, n_in = spec.shapes[-1]
    last = np.concatenate([now[:, :n_in].ravel(), now[:, n_in]])
    return np.concatenate([halves[: spec.size - n_out * (n_in + 1)], last.astype(np.float16)])


def _inputs(spec: MappingSpec, theta: Array) -> Array:
    """Return what the function is applied to: canonical points and, for k > 1, their images."""
    images = [canonical_points(spec.domain, POINTS)]
    for _ in range(spec.k - 1):
        images.append(apply(spec, theta, images[-1]))
    return np.concatenate(images)


def _last_inputs(spec: MappingSpec, theta: Array, x: Array) -> Array:
    """Return the inputs of the last layer, and ones for its vector: (n, hidden + 1)."""
    *hidden, _ = layers(spec, theta)
    for w, b in hidden:
        x = x @ w.T + b
        x = np.maximum(x, 0) if spec.activation == "relu" else np.tanh(x)
    return np.concatenate([x, np.ones((len(x), 1), np.float32)], axis=1)


def _last_layer(spec: MappingSpec, theta: Array) -> Array:
    """Return the last layer's matrix with its vector as one more column: (out, hidden + 1)."""
    w, b = layers(spec, theta)[-1]
    return np.concatenate([w, b[:, None]], axis=1)


def _other_neighbors(theta: Array, halves: Halves) -> Array:
    """Return the float16 numbers on the other side of theta's numbers; numbers that are float16's stay."""
    rounded_theta = halves.astype(np.float32)
    towards = np.where(rounded_theta < theta, np.float16(np.inf), np.float16(-np.inf))
    return np.where(rounded_theta == theta, theta, np.nextafter(halves, towards).astype(np.float32))
