"""The sampler, on plain NumPy and on the compiled kernel."""

import tracemalloc
from collections import deque
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from service.errors import CorruptWeights, InvalidParameter, InvalidSpec
from service.mapping import compiled
from service.mapping.canonical import BLOCK, canonical_points
from service.mapping.folding import CompiledFold, Fold, NumpyFold
from service.mapping.sampler import CHUNK, sample
from service.mapping.spec import HOF_1, HOF_3, Array, Domain, MappingSpec, apply, compose, initial_theta
from tests.service.mapping.engines import built_kernel, needs_kernel

SMALL = MappingSpec("small", 3, (16,), 3)
WIDE = MappingSpec("wide", 3, (256, 256), 3)


@pytest.fixture(params=["numpy", pytest.param("kernel", marks=needs_kernel)], autouse=True, scope="module")
def engine(request: pytest.FixtureRequest) -> Iterator[str]:
    """Run every test on plain NumPy and on the compiled kernel."""
    with pytest.MonkeyPatch.context() as patch:
        if request.param == "numpy":
            patch.setattr(compiled, "load", lambda: None)
        else:
            built_kernel()
        yield request.param


def cloud(spec: MappingSpec, word: Sequence[Array], n: int, **options: Any) -> Array:  # noqa: ANN401
    return np.concatenate(list(sample(spec, word, n, **options)))


def thetas(spec: MappingSpec) -> list[Array]:
    """Return a word of k different functions."""
    return [initial_theta(spec, seed) for seed in range(spec.k)]


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


def test_sample_of_a_word_applies_the_last_function_first() -> None:
    spec = SMALL.with_k(2)
    a, b = thetas(spec)
    assert not np.allclose(cloud(spec, [a, b], 100), cloud(spec, [b, a], 100), atol=1e-3)


@pytest.mark.parametrize("spec", [SMALL.with_k(2), HOF_1, HOF_3, WIDE], ids=lambda spec: spec.name)
@given(
    n=st.integers(1, 3 * BLOCK // 2),
    offset=st.integers(0, 5 * BLOCK) | st.integers(0, 2**40),  # whole networks, folded ones and both
    chunk=st.integers(100, 2 * BLOCK),
    data=st.data(),
)
@settings(max_examples=15, deadline=None)
def test_sample_in_any_window_and_chunking_is_bitwise_equal(
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
def test_sample_in_chunks_gives_bounded_chunks_of_n_points(n: int, offset: int, chunk: int) -> None:
    sizes = [points.shape for points in sample(SMALL, thetas(SMALL), n, offset=offset, chunk=chunk)]
    assert sum(m for m, _ in sizes) == n
    assert all(0 < m <= chunk and d == 3 for m, d in sizes)


@pytest.mark.parametrize("width", [1, 5, 16, *(pytest.param(wide, marks=pytest.mark.slow) for wide in (1000, 1024))])
@pytest.mark.parametrize("domain", ["ball", "sphere", "cube"])
def test_folded_networks_of_any_size_agree_with_the_reference(width: int, domain: Domain) -> None:
    spec = MappingSpec("one layer", 3, (width,), 3, domain=domain, k=3)
    word, n = thetas(spec), CHUNK
    expected = compose(spec, word, canonical_points(domain, n, offset=n))
    points = cloud(spec, word, n, offset=n)
    np.testing.assert_allclose(points, expected, atol=1e-5 * np.abs(expected).max())


def test_fold_is_exact_inside_its_box_and_whole_outside() -> None:
    spec, box = HOF_1, np.ones(3)
    theta = initial_theta(spec)
    fold = Fold(spec, theta, -box, box, 5)
    x = np.random.default_rng(0).uniform(-2, 2, (3, 5_000)).astype(np.float32)
    expected = apply(spec, theta, np.ascontiguousarray(x.T)).T
    kernel = compiled.load()
    evaluate = CompiledFold(fold, kernel) if kernel else NumpyFold(fold)
    np.testing.assert_allclose(evaluate.map(x), expected, atol=2e-6 * np.abs(expected).max())
    outside = (np.abs(x) > 1).any(axis=0)
    assert 0 < outside.mean() < 1
    np.testing.assert_array_equal(fold.cells(x) == 5**3, outside)


def test_fold_leaves_few_units_to_a_cell() -> None:
    box = np.ones(3)
    fold = Fold(HOF_1, initial_theta(HOF_1), -box, box, 8)
    assert fold.crossing[:-1].mean() < 0.25
    assert fold.crossing[-1].all()


def test_sampler_folds_only_one_hidden_layer_of_relus_in_space() -> None:
    assert HOF_1.is_one_relu_layer
    assert not HOF_3.is_one_relu_layer
    assert not MappingSpec("tanh", 3, (8,), 3, "tanh").is_one_relu_layer
    assert not MappingSpec("four", 4, (8,), 3, domain="ball4").is_one_relu_layer


def test_fold_of_a_constant_function_gives_its_value() -> None:
    spec = SMALL.with_k(2)
    theta = initial_theta(spec) * 0
    theta[-3:] = [1, 2, 3]  # the output's bias
    np.testing.assert_array_equal(cloud(spec, [theta, theta], 10, offset=CHUNK), np.tile([1, 2, 3], (10, 1)))


def test_sample_with_intermediate_values_beyond_float32_raises_corrupt_weights() -> None:
    """NaN must not be lost in a comparison, nor be sorted into a cell that does not exist."""
    spec = SMALL.with_k(2)
    large = initial_theta(spec)
    large[-51:] = 3e38
    for offset in (0, CHUNK):
        with pytest.raises(CorruptWeights):
            cloud(spec, [initial_theta(spec), large], 1_000, offset=offset)


def test_sample_with_another_seed_gives_other_points() -> None:
    word = thetas(SMALL)
    assert (cloud(SMALL, word, 100, seed=0) != cloud(SMALL, word, 100, seed=1)).any(axis=1).all()


def test_sample_with_scale_multiplies_the_points() -> None:
    word = thetas(SMALL)
    np.testing.assert_array_equal(cloud(SMALL, word, 300, scale=2.5), np.float32(2.5) * cloud(SMALL, word, 300))


def test_sample_chunks_do_not_share_memory() -> None:
    first, second = sample(SMALL, thetas(SMALL), 2 * BLOCK, chunk=BLOCK)
    assert not np.shares_memory(first, second)


def test_sample_leaves_the_word_unchanged() -> None:
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


def test_sample_memory_does_not_grow_with_n() -> None:
    peak_bytes(1_300_000)  # what is loaded by a first call is of no cloud
    assert peak_bytes(1_300_000) < 1.1 * peak_bytes(130_000)


def test_sample_of_a_function_beyond_float32_raises_corrupt_weights() -> None:
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
def test_sample_with_bad_arguments_raises_before_the_first_chunk(change: dict[str, Any], field: str) -> None:
    arguments: dict[str, Any] = {"spec": SMALL, "word": thetas(SMALL), "n": 10} | change
    with pytest.raises(InvalidParameter) as caught:
        sample(**arguments)
    assert caught.value.field == field


def test_sample_with_a_theta_that_does_not_fit_raises_before_the_first_chunk() -> None:
    with pytest.raises(InvalidSpec):
        sample(SMALL, [np.zeros(7, np.float32)], 10)
