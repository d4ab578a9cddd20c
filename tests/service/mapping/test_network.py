"""Whole networks in the compiled kernel against the mapping, with every instruction set that the processor has."""

import numpy as np
import pytest

from service.mapping.spec import Array, MappingSpec, apply, initial_theta
from tests.service.mapping.engines import built_kernel, instruction_sets, needs_kernel, weights

SETS = instruction_sets()
pytestmark = [needs_kernel, pytest.mark.parametrize("instructions", SETS.values(), ids=SETS)]
EXACT = 2e-6  # of the largest value
DEEP = [
    MappingSpec("one of tanh", 3, (500,), 3, "tanh"),
    MappingSpec("narrow", 3, (1, 2, 3, 4, 5), 3),
    MappingSpec("deep", 3, (128, 128, 128), 3),
    MappingSpec("deep of tanh", 3, (17, 9, 30), 3, "tanh"),
    MappingSpec("wide", 3, (257, 600), 3),
    MappingSpec("of four inputs", 4, (70,), 3, domain="ball4"),
]


def network(spec: MappingSpec, theta: Array, x: Array, instructions: int) -> Array:
    """Compute a network's values by the kernel, with one instruction set."""
    y, widths = np.full((3, x.shape[1]), np.nan, np.float32), np.array([spec.input_dim, *spec.hidden, spec.output_dim])
    built_kernel().network(x, theta, widths, spec.activation == "tanh", y, instructions)
    return y


@pytest.mark.parametrize("spec", DEEP, ids=lambda spec: spec.name)
@pytest.mark.parametrize("n", [0, 1, 31, 97])
def test_network_of_any_layers_gives_the_values_of_the_mapping(spec: MappingSpec, n: int, instructions: int) -> None:
    theta = weights(spec, n)
    x = np.random.default_rng(n).uniform(-1.5, 1.5, (spec.input_dim, n)).astype(np.float32)
    expected = apply(spec, theta.astype(np.float64), x.T.astype(np.float64)).T
    values = network(spec, theta, x, instructions)
    np.testing.assert_allclose(values, expected, rtol=0, atol=EXACT * np.abs(expected).max(initial=0))


@pytest.mark.parametrize("spec", DEEP, ids=lambda spec: spec.name)
def test_network_gives_a_point_the_same_bits_among_any_others(spec: MappingSpec, instructions: int) -> None:
    theta = weights(spec, 1)
    x = np.random.default_rng(0).uniform(-1.5, 1.5, (spec.input_dim, 200)).astype(np.float32)
    whole = network(spec, theta, x, instructions)
    for begin, end in ((0, 1), (17, 18), (3, 50), (100, 200)):
        part = network(spec, theta, np.ascontiguousarray(x[:, begin:end]), instructions)
        assert part.tobytes() == np.ascontiguousarray(whole[:, begin:end]).tobytes()


@pytest.mark.parametrize("spec", DEEP, ids=lambda spec: spec.name)
def test_network_keeps_nan(spec: MappingSpec, instructions: int) -> None:
    theta = weights(spec, 0)
    x = np.random.default_rng(0).uniform(-1, 1, (spec.input_dim, 100)).astype(np.float32)
    finite = network(spec, theta, x, instructions)
    x[1, 33] = np.nan
    values = network(spec, theta, x, instructions)
    assert np.isnan(values[:, 33]).all()
    others = np.arange(100) != 33
    np.testing.assert_array_equal(values[:, others], finite[:, others])


@pytest.mark.parametrize("hidden", [(1,), (1, 1)], ids=["fused", "layers"])
def test_tanh_is_exact_to_5e_7(hidden: tuple[int, ...], instructions: int) -> None:
    """The first unit computes tanh(x); deeper ones are linear there."""
    spec = MappingSpec("tanh", 3, hidden, 3, "tanh")
    theta = np.zeros(spec.size, np.float32)
    theta[0] = 1
    small = 2.0**-10  # tanh(small u) / small is u to 4e-7
    if len(hidden) == 2:
        theta[4] = small
    theta[-6] = 1 if len(hidden) == 1 else 1 / small
    edges = np.array([0, np.inf, -np.inf, 8.5, -8.5, 1e30, 1e-30], np.float32)
    x = np.zeros((3, 200_007), np.float32)
    x[0] = np.concatenate([np.linspace(-10, 10, 200_000, dtype=np.float32), edges])
    values, expected = network(spec, theta, x, instructions)[0], np.tanh(x[0].astype(np.float64))
    if len(hidden) == 2:
        expected = np.tanh(small * expected) / small
    np.testing.assert_allclose(values, expected, rtol=0, atol=5e-7)


@pytest.mark.parametrize("width", [1, 64, 65, 500])
@pytest.mark.parametrize("n", [1, 31, 97])
def test_network_gives_the_values_of_the_mapping(width: int, n: int, instructions: int) -> None:
    spec = MappingSpec("one layer", 3, (width,), 3)
    theta = initial_theta(spec, n)
    theta += np.random.default_rng(n).normal(0, 0.05, theta.size).astype(np.float32)
    x = np.random.default_rng(n).uniform(-1.5, 1.5, (3, n)).astype(np.float32)
    y, expected = np.full_like(x, np.nan), apply(spec, theta, np.ascontiguousarray(x.T)).T
    built_kernel().network(x, theta, np.array([3, width, 3]), False, y, instructions)
    np.testing.assert_allclose(y, expected, rtol=0, atol=EXACT * np.abs(expected).max())
