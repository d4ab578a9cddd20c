import itertools
import tracemalloc
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats
from scipy.stats import qmc

from service import kernel
from service.canonical import BLOCK, canonical_points
from service.errors import CorruptWeights, InvalidParameter, InvalidSpec
from service.mapping import DOMAIN_DIMS, HOF_1, HOF_3, Array, Domain, MappingSpec, compose, initial_theta
from service.sampler import SMALL_TILES, TILE, bounds, sample, tile_size

Values = npt.NDArray[np.floating[Any]]

DOMAINS: list[Domain] = ["ball", "sphere", "ball4", "cube"]
SMALL = MappingSpec("small", 3, (16,), 3)
WIDE = MappingSpec("wide", 3, (256, 256), 3)  # no tile of it stays within one BLAS thread
ALPHA = 1e-3  # seeds are fixed, so a test that passes once always passes


@pytest.fixture(params=["numpy", "fast"], autouse=True, scope="module")
def engine(request: pytest.FixtureRequest) -> Iterator[str]:
    """Every test runs on plain NumPy and on the compiled kernel."""
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "numpy":
            patch.setattr(kernel, "load", lambda: None)
        else:
            assert kernel.load() is not None, "numba is missing: the extra `fast` is a part of `dev`"
        yield request.param


def cloud(spec: MappingSpec, word: Sequence[Array], n: int, **options: Any) -> Array:  # noqa: ANN401
    return np.concatenate(list(sample(spec, word, n, **options)))


def thetas(spec: MappingSpec) -> list[Array]:
    """A word of k different functions."""
    return [initial_theta(spec, seed) for seed in range(spec.k)]


# Canonical points


@pytest.mark.parametrize("domain", DOMAINS)
def test_canonical_points_shape_and_type(domain: Domain) -> None:
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
def test_any_window_of_canonical_points_is_the_same_points(
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
def test_seeds_differ(domain: Domain) -> None:
    a, b = canonical_points(domain, 1000, seed=0), canonical_points(domain, 1000, seed=1)
    assert not (a == b).all(axis=1).any()


@pytest.mark.parametrize("domain", DOMAINS)
def test_no_point_comes_twice(domain: Domain) -> None:
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


def test_sobol_is_scipys_sequence_with_a_digital_shift() -> None:
    """SciPy's is the independent implementation: the first numbers of all four lanes, as 32-bit integers."""
    raw = (qmc.Sobol(4, scramble=False, bits=32).random(4 * BLOCK)[:, :3] * 2**32).astype(np.uint32)
    shift = np.random.Philox(key=9).random_raw(4).astype(np.uint32)[:3]
    expected = 2 * (((raw ^ shift) >> 8) * np.float32(2**-24)) - 1
    np.testing.assert_array_equal(canonical_points("cube", 4 * BLOCK, 9, sampling="sobol"), expected.astype(np.float32))


@pytest.mark.parametrize("domain", DOMAINS)
def test_sobol_windows_are_the_same_points(domain: Domain) -> None:
    whole = canonical_points(domain, 3 * BLOCK, 5, 2**31 - BLOCK - 7, sampling="sobol")
    part = canonical_points(domain, BLOCK, 5, 2**31 - 50, sampling="sobol")
    assert part.tobytes() == whole[BLOCK - 43 :][:BLOCK].tobytes()


@pytest.mark.parametrize("domain", DOMAINS)
def test_sobol_halves_of_every_axis_hold_as_many_points(domain: Domain) -> None:
    above = (canonical_points(domain, 2**14, 1, sampling="sobol") > 0).mean(axis=0)
    np.testing.assert_allclose(above, 0.5, atol=1e-3)  # independent points stray by 4e-3


# Sampling


@pytest.mark.parametrize(
    "spec",
    [
        HOF_1,
        HOF_1.with_k(2),
        HOF_1.with_k(4),
        HOF_3,
        HOF_3.with_k(2),
        MappingSpec("deep", 3, (32, 48, 16, 64, 8), 3, k=2),
        MappingSpec("tanh", 3, (64, 64), 3, activation="tanh", k=2),
        WIDE,
        MappingSpec("sphere", 3, (64,), 3, domain="sphere", k=2),
        MappingSpec("cube", 3, (64,), 3, domain="cube"),
        MappingSpec("4D", 4, (64, 32), 3, domain="ball4"),
    ],
    ids=lambda spec: f"{spec.name}-k{spec.k}",
)
def test_sample_is_the_composition_of_the_canonical_points(spec: MappingSpec) -> None:
    word = thetas(spec)
    points = cloud(spec, word, 5_000, seed=3, offset=777)
    expected = compose(spec, word, canonical_points(spec.domain, 5_000, 3, 777))
    np.testing.assert_allclose(points, expected, atol=2e-6 * np.abs(expected).max())
    assert points.dtype == np.float32


def test_the_last_function_of_a_word_is_applied_first() -> None:
    spec = SMALL.with_k(2)
    a, b = thetas(spec)
    assert not np.allclose(cloud(spec, [a, b], 100), cloud(spec, [b, a], 100), atol=1e-3)


@pytest.mark.parametrize("spec", [SMALL.with_k(2), HOF_1, HOF_3, WIDE], ids=lambda spec: spec.name)
@given(
    n=st.integers(1, 3 * BLOCK // 2),
    offset=st.integers(0, 3 * BLOCK) | st.integers(0, 2**40),
    chunk=st.integers(100, 2 * BLOCK),
    data=st.data(),
)
@settings(max_examples=15, deadline=None)
def test_outputs_are_bitwise_equal_in_any_window_and_chunking(
    spec: MappingSpec, n: int, offset: int, chunk: int, data: st.DataObject
) -> None:
    word = thetas(spec)
    whole = cloud(spec, word, n, offset=offset)
    assert cloud(spec, word, n, offset=offset, chunk=chunk).tobytes() == whole.tobytes()
    begin = data.draw(st.integers(0, n - 1))
    m = data.draw(st.integers(1, n - begin))
    assert cloud(spec, word, m, offset=offset + begin).tobytes() == whole[begin : begin + m].tobytes()


@given(n=st.integers(1, 20_000), offset=st.integers(0, 10_000), chunk=st.integers(50, 20_000))
@settings(max_examples=30, deadline=None)
def test_chunks_are_bounded_and_make_n_points(n: int, offset: int, chunk: int) -> None:
    sizes = [points.shape for points in sample(SMALL, thetas(SMALL), n, offset=offset, chunk=chunk)]
    assert sum(m for m, _ in sizes) == n
    assert all(0 < m <= chunk and d == 3 for m, d in sizes)


@pytest.mark.parametrize("width", [1, 5, 16, 1000, 1024])
def test_the_kernel_agrees_with_the_reference(width: int) -> None:
    spec = MappingSpec("one layer", 3, (width,), 3, k=2)
    assert kernel.fits(spec)
    word = thetas(spec)
    expected = compose(spec, word, canonical_points("ball", 1000))
    np.testing.assert_allclose(cloud(spec, word, 1000), expected, atol=1e-5 * np.abs(expected).max())


def test_the_kernel_leaves_other_networks_alone() -> None:
    assert not kernel.fits(HOF_3)
    assert not kernel.fits(MappingSpec("tanh", 3, (8,), 3, "tanh"))
    assert not kernel.fits(MappingSpec("four", 4, (8,), 3, domain="ball4"))


def test_seed_changes_the_points() -> None:
    word = thetas(SMALL)
    assert (cloud(SMALL, word, 100, seed=0) != cloud(SMALL, word, 100, seed=1)).any(axis=1).all()


def test_scale_multiplies() -> None:
    word = thetas(SMALL)
    np.testing.assert_array_equal(cloud(SMALL, word, 300, scale=2.5), np.float32(2.5) * cloud(SMALL, word, 300))


def test_chunks_do_not_share_memory() -> None:
    first, second = sample(SMALL, thetas(SMALL), 2 * BLOCK, chunk=BLOCK)
    assert not np.shares_memory(first, second)


def test_the_word_is_not_mutated() -> None:
    word = thetas(SMALL)
    before = word[0].copy()
    cloud(SMALL, word, 100, scale=3)
    np.testing.assert_array_equal(word[0], before)


def peak_bytes(n: int) -> int:
    tracemalloc.start()
    deque(sample(SMALL, thetas(SMALL), n), maxlen=0)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak


def test_memory_does_not_grow_with_n() -> None:
    assert peak_bytes(1_300_000) < 1.1 * peak_bytes(130_000)


def test_a_function_beyond_float32_is_refused() -> None:
    theta = np.full(SMALL.size, 3e38, np.float32)
    with pytest.raises(CorruptWeights, match="float32"):
        cloud(SMALL, [theta], 10)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"n": 0}, "n"),
        ({"seed": -1}, "seed"),
        ({"seed": 2**64}, "seed"),
        ({"offset": -1}, "offset"),
        ({"offset": 2**63}, "offset"),
        ({"chunk": 0}, "chunk"),
        ({"scale": 0.0}, "scale"),
        ({"scale": -1.0}, "scale"),
        ({"scale": float("nan")}, "scale"),
        ({"scale": float("inf")}, "scale"),
        ({"word": []}, "word"),
        ({"word": thetas(SMALL.with_k(2))}, "word"),
    ],
)
def test_bad_arguments_are_refused_before_the_first_chunk(change: dict[str, Any], field: str) -> None:
    arguments: dict[str, Any] = {"spec": SMALL, "word": thetas(SMALL), "n": 10} | change
    with pytest.raises(InvalidParameter) as caught:
        sample(**arguments)
    assert caught.value.field == field


def test_a_theta_that_does_not_fit_is_refused_before_the_first_chunk() -> None:
    with pytest.raises(InvalidSpec):
        sample(SMALL, [np.zeros(7, np.float32)], 10)


def test_tiles_stay_within_one_thread_and_divide_a_block() -> None:
    assert tile_size(HOF_1) == TILE
    assert tile_size(HOF_3) == 32
    assert tile_size(WIDE) == TILE
    assert all(BLOCK % size == 0 for size in (TILE, *SMALL_TILES, kernel.TILE))
    assert kernel.TILE % 4 == 0


def test_bounds() -> None:
    chunks = [np.array([[1, 5, -2], [3, 4, 0]], np.float32), np.array([[-7, 4.5, 9]], np.float32)]
    low, high = bounds(iter(chunks))
    np.testing.assert_array_equal(low, [-7, 4, -2])
    np.testing.assert_array_equal(high, [3, 5, 9])
    assert low.dtype == high.dtype == np.float32


def test_bounds_of_nothing() -> None:
    with pytest.raises(ValueError, match="not enough values"):
        bounds(iter(()))
