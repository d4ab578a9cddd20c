"""Experiment 6, first part: a concatenated latent vector (LVC) equals a bias of the first layer (paper, section 2).

A decoder that reads a point x and a latent vector z, [x; z], computes W_x x + W_z z + b in its first layer. W_z z + b
does not depend on x, so it is a bias: for every object the decoder is a mapping function whose theta differs from that
of other objects in the first layer's biases alone. Both are computed here for random decoders and random latents.
"""

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from model.evaluation.paper.record import PaperRecord, Trial
from model.provenance import provenance
from service.mapping.canonical import canonical_points
from service.mapping.spec import HOF_1, HOF_3, MappingSpec, apply, initial_theta, layers

EXPERIMENT: Final = "latent"
SPECS: Final = (HOF_1, HOF_3)
OBJECTS: Final = 100
LATENT: Final = 256  # numbers, as in DeepSDF
POINTS: Final = 1_000
FIGURE: Final = "difference"  # largest of a coordinate, divided by the largest coordinate

Numbers = npt.NDArray[Any]  # of either precision


def measure_latent(seed: int = 0) -> PaperRecord:
    """Compare both forms of OBJECTS random objects, for each spec and precision."""
    trials = [
        Trial(
            trial_name(spec, dtype),
            {FIGURE: [_difference(spec, dtype, np.random.default_rng([seed, each])) for each in range(OBJECTS)]},
        )
        for spec in SPECS
        for dtype in (np.float32, np.float64)
    ]
    setting = {"objects": OBJECTS, "latent": LATENT, "points": POINTS}
    ids = [str(number) for number in range(OBJECTS)]
    return PaperRecord(EXPERIMENT, setting, provenance(seed), ids, ["random"] * OBJECTS, trials)


def trial_name(spec: MappingSpec, dtype: type[np.floating[Any]]) -> str:
    """Return the name of a spec and a precision in the record."""
    return f"{spec.name}, {np.dtype(dtype).name}"


def with_latent(spec: MappingSpec, theta: Numbers, w_z: Numbers, z: Numbers, x: Numbers) -> Numbers:
    """Return a decoder's points for [x; z] (n, d + latent): theta, with `w_z` (width, latent) as more inputs."""
    (w, b), *rest = layers(spec, theta)
    inputs = np.concatenate([x, np.broadcast_to(z, (len(x), len(z)))], axis=1)
    y: Numbers = inputs @ np.concatenate([w, w_z], axis=1).T + b
    for w_next, b_next in rest:
        y = np.maximum(y, 0) @ w_next.T + b_next
    return y


def as_bias(spec: MappingSpec, theta: Numbers, w_z: Numbers, z: Numbers) -> Numbers:
    """Return theta of the same object: the first layer's biases plus W_z z, all other numbers unchanged."""
    n_out, n_in = spec.shapes[0]
    own = theta.copy()
    own[n_out * n_in : n_out * n_in + n_out] += w_z @ z
    return own


def _difference(spec: MappingSpec, dtype: type[np.floating[Any]], rng: np.random.Generator) -> float:
    theta = initial_theta(spec, int(rng.integers(2**31))).astype(dtype)
    z = rng.normal(size=LATENT).astype(dtype)
    w_z = (rng.normal(size=(spec.hidden[0], LATENT)) / LATENT**0.5).astype(dtype)
    x = canonical_points(spec.domain, POINTS).astype(dtype)
    points = with_latent(spec, theta, w_z, z, x)
    own = apply(spec, as_bias(spec, theta, w_z, z), x)
    return float(np.abs(own - points).max() / np.abs(points).max())
