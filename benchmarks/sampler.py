"""How fast points are computed: `service.sampler` against the plain forward pass, on one core.

Both map the same canonical points through the same random theta; each pair runs back to back, so that
what else the machine does hits both. Writes benchmarks/RESULTS.md.
"""

import argparse
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
import numpy.typing as npt

from model.provenance import provenance
from service.canonical import canonical_points
from service.mapping import HOF_1, HOF_3, MappingSpec, initial_theta, power
from service.sampler import sample

RESULTS: Final = Path(__file__).with_name("RESULTS.md")
SPECS: Final = (HOF_1, HOF_1.with_k(2), HOF_3)
SEED: Final = 0
POINTS: Final = 200_000
PAIRS: Final = 11

Floats = npt.NDArray[np.float64]


def main() -> int:
    """Measure, print and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=PAIRS, help=f"runs of each; default: {PAIRS}")
    parser.add_argument("--points", type=int, default=POINTS, help=f"points of a run; default: {POINTS}")
    parser.add_argument("-o", "--output", type=Path, default=RESULTS, help="default: benchmarks/RESULTS.md")
    arguments = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    times = {spec: measure(spec, arguments.points, arguments.pairs) for spec in SPECS}
    text = report(times, arguments.points, arguments.pairs)
    arguments.output.write_text(text, encoding="utf-8")
    print(text, end="")
    return 0


def measure(spec: MappingSpec, points: int, pairs: int) -> Floats:
    """Seconds of each run, canonical points included: (pairs, 2), the plain forward pass and the sampler."""
    theta = initial_theta(spec, SEED)

    def plain() -> None:
        power(spec, theta, canonical_points(spec.domain, points, SEED))

    def tiled() -> None:
        for _ in sample(spec, [theta] * spec.k, points, seed=SEED):
            pass

    plain()
    tiled()  # the first run pays for memory that later ones find
    return np.array([[seconds(plain), seconds(tiled)] for _ in range(pairs)])


def seconds(run: Callable[[], None]) -> float:
    """Wall time of a call."""
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def report(times: dict[MappingSpec, Floats], points: int, pairs: int) -> str:
    """The results as Markdown: medians over the pairs, the ratio's with its quartiles."""
    made = provenance(SEED)
    lines = [
        "# Sampler",
        "",
        f"`make bench`: {points:,} points a run, medians of {pairs} pairs, one core, one BLAS thread, float32.",
        f"{made['machine']}, NumPy {np.__version__}; {made['date']}, seed {made['seed']}, commit {made['commit']}.",
        "",
        "| mapping | k | plain forward pass, Mpoints/s | sampler, Mpoints/s | times faster (quartiles) |",
        "|---|---|---|---|---|",
    ]
    for spec, pair in times.items():
        plain, tiled = points / np.median(pair, axis=0) / 1e6
        low, median, high = np.quantile(pair[:, 0] / pair[:, 1], [0.25, 0.5, 0.75])
        lines.append(f"| {spec.name} | {spec.k} | {plain:.2f} | {tiled:.2f} | {median:.1f} ({low:.1f} to {high:.1f}) |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
