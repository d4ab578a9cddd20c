"""Timing: on one core, in turn, medians of rounds, with the same search of tile sizes for all."""

import os
import time
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
import numpy.typing as npt

from benchmarks.speed.networks import Network
from benchmarks.speed.rivals import Evaluate, Make
from service.mapping.spec import Array

TILES: Final = (128, 256, 512, 1024, 4096, 16_384)
SEARCH_FLOPS: Final = 4e9  # of one timed run of the search
SEARCH_RUNS: Final = 3

Seconds = npt.NDArray[np.float64]


def pin() -> int:
    """Keep this process on one core, the first that it may use, and return it."""
    core = min(os.sched_getaffinity(0))
    os.sched_setaffinity(0, {core})
    return core


def seconds(run: Callable[[], object]) -> float:
    """Wall time of a call."""
    start = time.perf_counter()
    run()
    return time.perf_counter() - start


def in_turn(runs: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, Seconds]:
    """Seconds of each run in each round, (rounds,); within a round all run back to back, after one warm-up."""
    for run in runs.values():
        run()
    table = [[seconds(run) for run in runs.values()] for _ in range(rounds)]
    return dict(zip(runs, np.array(table).T, strict=True))


def ratio(slow: Seconds, fast: Seconds) -> float:
    """Return how many times faster the second run is: the median over the rounds."""
    return float(np.median(slow / fast))


def best_tile(make: Make, network: Network, tiles: tuple[int, ...] = TILES) -> tuple[int, Evaluate]:
    """Return the tile size at which a way is fastest, and the way with it. Checks its values first.

    Raises
    ------
    ValueError : the way computes something else than the network's reference.

    """
    n = max(2048, int(SEARCH_FLOPS / network.flops) // 2048 * 2048)
    x = np.random.default_rng(0).uniform(-1, 1, (min(n, 65_536), network.layers[0].w.shape[1])).astype(np.float32)
    best: tuple[float, int, Evaluate] | None = None
    for tile in (tile for tile in tiles if tile <= len(x)):
        evaluate = make(network, tile)
        _check(network, evaluate, x[:1000])
        took = min(seconds(lambda e=evaluate: e(x)) for _ in range(SEARCH_RUNS))  # type: ignore[misc]
        if best is None or took < best[0]:
            best = (took, tile, evaluate)
    if best is None:
        raise ValueError("no tile size to search")
    return best[1], best[2]


def _check(network: Network, evaluate: Evaluate, x: Array) -> None:
    expected = network.reference(x)
    if np.abs(evaluate(x) - expected).max() > 1e-4 * np.abs(expected).max():
        raise ValueError(f"{network.name} is computed wrongly")
