"""Measure the time of a point by the shape of its function, and fit the prices of `service.runtime.cost`.

`OPENBLAS_NUM_THREADS=1 python -m benchmarks.speed.costs > benchmarks/COSTS.md` writes the report.
"""

import argparse
from typing import Final
from unittest import mock

import numpy as np

from benchmarks.speed.timing import pin
from model.provenance import provenance
from service.mapping import compiled
from service.mapping.sampler import hold_blas_to_one_thread
from service.mapping.spec import HOF_1, HOF_3, Activation, Domain, MappingSpec
from service.runtime.cost import cost_of, counts_of, prices_ns
from tests.support.point_times import Values, measure

WORST: Final = 1.5  # factor between charge and measurement that the prices must keep
ROUNDS: Final = 5


def _spec(*hidden: int, activation: Activation = "relu", k: int = 1, domain: Domain = "ball") -> MappingSpec:
    return MappingSpec("x", 4 if domain == "ball4" else 3, hidden, 3, activation, k, domain)


SHAPES: Final = (
    HOF_1.with_k(2),
    HOF_1,
    HOF_1.with_k(4),
    HOF_1.with_k(16),
    _spec(64, k=16),
    _spec(256, k=16),
    _spec(3_000, k=4),
    _spec(3_000, k=16),
    _spec(8_192, k=4),
    _spec(28_571),
    _spec(28_571, k=8),
    _spec(65_536),
    HOF_3,
    HOF_3.with_k(2),
    _spec(*[1] * 64, k=16),
    _spec(*[8] * 64, k=4),
    _spec(*[16] * 16),
    _spec(*[64] * 64),
    _spec(*[256] * 4),
    _spec(*[512] * 8),
    _spec(*[1_024] * 2),
    _spec(*[1_024] * 4),
    _spec(1_024, domain="ball4"),
    _spec(8_192, domain="ball4"),
    _spec(65_536, domain="ball4"),
    _spec(32, activation="tanh"),
    _spec(1_024, activation="tanh"),
    _spec(1_024, activation="tanh", k=2),
    _spec(8_192, activation="tanh", k=2),
    _spec(65_536, activation="tanh"),
    _spec(128, 128, 128, activation="tanh"),
    _spec(*[1] * 64, activation="tanh", k=16),
    _spec(*[16] * 16, activation="tanh"),
    _spec(*[64] * 64, activation="tanh"),
    _spec(*[256] * 4, activation="tanh"),
    _spec(*[1_024] * 2, activation="tanh"),
)


def main() -> None:
    """Measure, fit and print: with the compiled kernel, then with NumPy alone."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    arguments = parser.parse_args()
    if not compiled.load():
        parser.error(compiled.NOT_BUILT)
    pin()
    hold_blas_to_one_thread()
    run = provenance(0)
    print("# Cost of a point by the shape of its function\n")
    print(
        f"Written by `python -m benchmarks.speed.costs`. {run['machine']}; {run['date']}, commit {run['commit']}. "
        f"Processor time of one thread, the least of {arguments.rounds} rounds. The "
        "points are those from index 16,384 on, which are folded if the function has one hidden layer of ReLUs. "
        f"The factor between charge and cost is to be at most {WORST}. A cost below 1 counts as 1."
    )
    _print_engine("With the compiled kernel", arguments.rounds)
    with mock.patch.object(compiled, "load", return_value=None):
        _print_engine("With NumPy alone", arguments.rounds)


def _print_engine(title: str, rounds: int) -> None:
    """Print the prices and the costs of what computes the points now."""
    measured, prices = measure(SHAPES, rounds), prices_ns()
    counts = np.array([[counts_of(spec)[name] for name in prices] for spec in SHAPES], dtype=np.float64)
    print(f"\n## {title}\n\n| price | in service/runtime/cost.py, ns | fitted here, ns |\n|---|---|---|")
    for (name, price), fitted in zip(prices.items(), fit(counts, measured), strict=True):
        print(f"| {name} | {price:g} | {fitted:.3g} |")
    charges = np.array([cost_of(spec) for spec in SHAPES])
    costs = np.maximum(1, measured / measured[0])
    print("\n| hidden layers | inputs | k | ns | cost in HOF-1, k = 2 | charge | charge / cost |")
    print("|---|---|---|---|---|---|---|")
    for spec, ns, cost, charge in zip(SHAPES, measured, costs, charges, strict=True):
        figures = f"{ns:.0f} | {cost:.2f} | {charge} | {charge / cost:.2f}"
        print(f"| {_label(spec)} | {spec.input_dim} | {spec.k} | {figures} |")
    worst = np.exp(np.abs(np.log(charges / costs)).max())
    print(f"\nLargest factor between charge and cost: {worst:.2f}.")


def fit(counts: Values, measured: Values) -> Values:
    """Return the prices that fit the measured times best, by least squares of relative errors; none is negative."""
    rows = counts / measured[:, None]
    chosen = np.ones(rows.shape[1], np.bool_)
    while True:
        prices = np.zeros(rows.shape[1])
        prices[chosen] = np.linalg.lstsq(rows[:, chosen], np.ones(len(rows)), rcond=None)[0]
        if (prices >= 0).all():
            return prices
        chosen &= prices >= 0


def _label(spec: MappingSpec) -> str:
    widths = f"{len(spec.hidden)} x {spec.hidden[0]:,}" if len(spec.hidden) > 1 else f"{spec.hidden[0]:,}"
    return f"{widths} {spec.activation}"


if __name__ == "__main__":
    main()
