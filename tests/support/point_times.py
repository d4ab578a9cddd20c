"""Time of a point by the shape of its function: shapes in turn, processor time of one thread."""

import time
from collections.abc import Sequence
from typing import Final

import numpy as np
import numpy.typing as npt

from service.mapping.folding import FROM
from service.mapping.sampler import Sampler
from service.mapping.spec import Array, MappingSpec
from service.runtime.cost import time_ns

POINTS: Final = (4_096, 32_768)  # of one call: the fewest, and the most
CALL_NS: Final = 50_000_000  # of one call, about

Values = npt.NDArray[np.float64]


def measure(specs: Sequence[MappingSpec], rounds: int) -> Values:
    """Return the processor time of a point of each shape in nanoseconds: the least of all rounds, (len(specs),)."""
    samplers = [Sampler(spec, [weights(spec, seed) for seed in range(spec.k)]) for spec in specs]
    counts = [_points(spec) for spec in specs]
    times = [
        [_ns_of_a_point(*each) for each in zip(samplers, counts, strict=True)]
        for _ in range(rounds + 1)  # the first round cuts the networks that are folded
    ]
    least: Values = np.array(times[1:]).min(axis=0)
    return least


def weights(spec: MappingSpec, seed: int) -> Array:
    """Draw weights that keep the scale of what they are applied to, so that points fill space for any k."""
    rng = np.random.default_rng(seed)
    parts = [
        part
        for n_out, n_in in spec.shapes
        for part in (rng.standard_normal(n_out * n_in) * (2 / n_in) ** 0.5, 0.1 * rng.standard_normal(n_out))
    ]
    return np.concatenate(parts).astype(np.float32)


def _points(spec: MappingSpec) -> int:
    fewest, most = POINTS
    return min(max(int(CALL_NS / time_ns(spec)) // fewest * fewest, fewest), most)


def _ns_of_a_point(sampler: Sampler, n: int) -> float:
    start = time.thread_time_ns()
    sampler.points(n, offset=FROM)
    return (time.thread_time_ns() - start) / n
