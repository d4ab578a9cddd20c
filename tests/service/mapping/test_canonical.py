"""Canonical points: prefix-stable by counter, uniform in every domain, Sobol as SciPy has it."""

import itertools
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.stats import qmc

from service.mapping.canonical import BLOCK, canonical_points
from service.mapping.spec import DOMAIN_DIMS, Domain

Values = npt.NDArray[np.floating[Any]]

DOMAINS: list[Domain] = ["ball", "sphere", "ball4", "cube"]
ALPHA = 1e-3  # seeds are fixed, so a test that passes once always passes


@pytest.mark.parametrize("domain", DOMAINS)
def test_canonical_points_of_any_domain_have_its_shape_and_type(domain: Domain) -> None:
    points = canonical_points(domain, 17)
    assert points.shape == (17, DOMAIN_DIMS[domain])
    assert points.dtype == np.float32
    assert points.flags.c_contiguous


@pytest.mark.parametrize("domain", DOMAINS)
@given(
    seed=st.integers(0, 2**64 - 1),
    offset=st.integers(0, 2**40),
    n=st.integers(1, 2 * BLOCK),
    data=st.data(),
)
@settings(max_examples=20, deadline=None)
def test_canonical_points_in_any_window_are_the_same(
    domain: Domain, seed: int, offset: int, n: int, data: st.DataObject
) -> None:
    whole = canonical_points(domain, n, seed, offset)
    begin = data.draw(st.integers(0, n - 1))
    m = data.draw(st.integers(1, n - begin))
    part = canonical_points(domain, m, seed, offset + begin)
    assert part.tobytes() == whole[begin : begin + m].tobytes()


def test_canonical_points_are_numpys_philox() -> None:
    """The definition, written out point by point: clients may rebuild the sample from it."""
    for index in (0, 1, 6, BLOCK, BLOCK + 1):
        raw = np.random.Philox(key=42, counter=index // 2).random_raw(4)
        lanes = [int(word) >> shift & 0xFFFFFFFF for word in raw for shift in (0, 32)][4 * (index % 2) :][:3]
        expected = [2 * (lane >> 8) / 2**24 - 1 for lane in lanes]
        np.testing.assert_array_equal(
            canonical_points("cube", 1, seed=42, offset=index)[0], np.array(expected, np.float32)
        )


@pytest.mark.parametrize("domain", DOMAINS)
def test_canonical_points_of_other_seeds_differ(domain: Domain) -> None:
    a, b = canonical_points(domain, 1000, seed=0), canonical_points(domain, 1000, seed=1)
    assert not (a == b).all(axis=1).any()


@pytest.mark.parametrize("domain", DOMAINS)
def test_canonical_points_are_all_different(domain: Domain) -> None:
    assert len(np.unique(canonical_points(domain, 3 * BLOCK), axis=0)) == 3 * BLOCK


def uniform(values: Values, low: float = 0, high: float = 1) -> None:
    result = stats.kstest(values, stats.uniform(low, high - low).cdf)
    assert result.pvalue > ALPHA


def uncorrelated(*columns: Values) -> None:
    for a, b in itertools.combinations(columns, 2):
        assert stats.spearmanr(a, b).pvalue > ALPHA


@pytest.mark.parametrize("seed", [0, 1])
def test_ball_is_uniform(seed: int) -> None:
    points = canonical_points("ball", 50_000, seed).astype(np.float64)
    radius = np.linalg.norm(points, axis=1)
    assert radius.max() <= 1 + 1e-6
    cosine, azimuth = points[:, 2] / radius, np.arctan2(points[:, 1], points[:, 0])
    uniform(radius**3)
    uniform(cosine, -1, 1)
    uniform(azimuth, -np.pi, np.pi)
    uncorrelated(radius, cosine, azimuth)


@pytest.mark.parametrize("seed", [0, 1])
def test_sphere_is_uniform(seed: int) -> None:
    points = canonical_points("sphere", 50_000, seed).astype(np.float64)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1, atol=1e-6)
    for axis in range(3):  # Archimedes: each coordinate of a uniform sphere is uniform
        uniform(points[:, axis], -1, 1)
    uncorrelated(points[:, 2], np.arctan2(points[:, 1], points[:, 0]))


@pytest.mark.parametrize("seed", [0, 1])
def test_ball4_is_uniform(seed: int) -> None:
    points = canonical_points("ball4", 50_000, seed).astype(np.float64)
    radius = np.linalg.norm(points, axis=1)
    assert radius.max() <= 1 + 1e-6
    uniform(radius**4)
    direction = points / radius[:, None]
    # A coordinate of uniform S^3 is 2 Beta(3/2, 3/2) - 1, on any axis.
    oblique = direction @ np.full(4, 0.5)
    for values in (*direction.T, oblique):
        assert stats.kstest((values + 1) / 2, stats.beta(1.5, 1.5).cdf).pvalue > ALPHA
    uncorrelated(radius, *direction.T)


@pytest.mark.parametrize("seed", [0, 1])
def test_cube_is_uniform(seed: int) -> None:
    points = canonical_points("cube", 50_000, seed)
    for axis in range(3):
        uniform(points[:, axis], -1, 1)
    uncorrelated(*points.T)


# Sobol


def test_sobol_points_are_scipys_sequence_with_a_digital_shift() -> None:
    """SciPy's is the independent implementation: the first numbers of all four lanes, as 32-bit integers."""
    raw = (qmc.Sobol(4, scramble=False, bits=32).random(4 * BLOCK)[:, :3] * 2**32).astype(np.uint32)
    shift = np.random.Philox(key=9).random_raw(4).astype(np.uint32)[:3]
    expected = 2 * (((raw ^ shift) >> 8) * np.float32(2**-24)) - 1
    np.testing.assert_array_equal(canonical_points("cube", 4 * BLOCK, 9, sampling="sobol"), expected.astype(np.float32))


@pytest.mark.parametrize("domain", DOMAINS)
def test_sobol_points_in_any_window_are_the_same(domain: Domain) -> None:
    whole = canonical_points(domain, 3 * BLOCK, 5, 2**31 - BLOCK - 7, sampling="sobol")
    part = canonical_points(domain, BLOCK, 5, 2**31 - 50, sampling="sobol")
    assert part.tobytes() == whole[BLOCK - 43 :][:BLOCK].tobytes()


@pytest.mark.parametrize("domain", DOMAINS)
def test_sobol_points_fill_both_halves_of_every_axis_equally(domain: Domain) -> None:
    above = (canonical_points(domain, 2**14, 1, sampling="sobol") > 0).mean(axis=0)
    np.testing.assert_allclose(above, 0.5, atol=1e-3)  # independent points stray by 4e-3
