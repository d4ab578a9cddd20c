"""The compiled search for the outermost points against NumPy's."""

from collections.abc import Callable

import numpy as np
import pytest

from service.mapping.canonical import canonical_points
from service.mapping.outermost import BLOCK, CANDIDATES, DOMAINS, KernelSearch, NumpySearch, Search
from service.mapping.spec import DOMAIN_DIMS, Array, Domain
from tests.service.mapping.engines import built_kernel, needs_kernel

pytestmark = needs_kernel
POINTS = 20 * BLOCK


def _searches(domain: Domain, values_at: Callable[[Array], Array]) -> tuple[Search, Search]:
    """Return the search of the kernel and that of NumPy, from the same probe."""
    probe = np.ascontiguousarray(canonical_points(domain, POINTS).T)
    around = np.random.default_rng(0).uniform(-1, 1, (len(probe), 5)).astype(np.float32)
    values = values_at(probe)
    return KernelSearch(built_kernel(), domain, probe, around, values), NumpySearch(domain, probe, around, values)


def _waves(x: Array) -> Array:
    """Map canonical points, (d, n), to values without ties, (3, n)."""
    return np.stack([np.sin(5 * x[0] + axis) + x[1] * x[2] + 0.3 * axis * x[-1] for axis in range(3)])


def _by_direction(search: Search) -> Array:
    return np.sort(search.reached.reshape(6, CANDIDATES), axis=1)


@pytest.mark.parametrize("domain", DOMAINS)
def test_search_of_the_kernel_reaches_what_numpys_does(domain: Domain) -> None:
    compiled, plain = _searches(domain, _waves)
    np.testing.assert_array_equal(_by_direction(compiled), _by_direction(plain))
    for radius in (0.3, 0.05):
        before = _by_direction(compiled)
        for search in (compiled, plain):
            trials = search.spread(radius)
            assert trials.shape == (DOMAIN_DIMS[domain], 6 * CANDIDATES * 5)
            search.climb(_waves(trials))
        np.testing.assert_allclose(_by_direction(compiled).max(axis=1), _by_direction(plain).max(axis=1), atol=1e-5)
        assert (_by_direction(compiled) >= before).all()


@pytest.mark.parametrize("domain", DOMAINS)
def test_spread_of_the_kernel_stays_within_the_domain(domain: Domain) -> None:
    trials = _searches(domain, _waves)[0].spread(2)
    lengths = np.abs(trials).max(axis=0) if domain == "cube" else np.linalg.norm(trials, axis=0)
    assert lengths.max() == pytest.approx(1, abs=1e-6)
    if domain == "sphere":
        assert lengths.min() == pytest.approx(1, abs=1e-6)


@pytest.mark.parametrize("place", [0, 7, POINTS - 1])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_search_from_a_value_that_is_not_finite_reaches_it(place: int, bad: float) -> None:
    def values_at(x: Array) -> Array:
        values = _waves(x)
        values[1, place] = bad
        return values

    for search in _searches("ball", values_at):
        assert not np.isfinite(search.reached).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_climb_to_a_value_that_is_not_finite_reaches_it(bad: float) -> None:
    for search in _searches("ball", _waves):
        values = _waves(search.spread(0.1))
        values[:, 3] = bad
        search.climb(values)
        search.climb(_waves(search.spread(0.1)))  # later values do not hide it
        assert not np.isfinite(search.reached).all()
