"""The measured box against the box of many points, for every domain and kind of network."""

import numpy as np
import pytest

from service.errors import CorruptWeights
from service.mapping import compiled
from service.mapping.box import examine, measure
from service.mapping.cloud import bounds
from service.mapping.sampler import Sampler, sample
from service.mapping.spec import HOF_1, Color, Functions, MappingSpec, initial_theta, word_of
from tests.service.mapping.engines import built_kernel, needs_kernel

POINTS = 2_000_000
CLOSE = 0.01  # of the longest side: what the documents promise
SPECS = [
    HOF_1.with_k(2),
    MappingSpec("ball", 3, (64,), 3),
    MappingSpec("sphere", 3, (64,), 3, domain="sphere"),
    MappingSpec("cube", 3, (32, 32), 3, domain="cube"),
    MappingSpec("ball4", 4, (64,), 3, domain="ball4"),
    MappingSpec("tanh", 3, (16, 16), 3, activation="tanh", k=3),
]


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)
@pytest.mark.parametrize("seed", [0, 1])
def test_box_is_close_to_that_of_many_points(spec: MappingSpec, seed: int) -> None:
    theta = initial_theta(spec, seed)
    frame = measure(spec, theta)
    low, high = bounds(sample(spec, word_of(spec, theta), POINTS))
    np.testing.assert_allclose(frame.low, low, atol=CLOSE * frame.unit)
    np.testing.assert_allclose(frame.high, high, atol=CLOSE * frame.unit)


@needs_kernel
@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)
def test_box_with_and_without_the_kernel_differs_by_a_thousandth_at_most(
    spec: MappingSpec, monkeypatch: pytest.MonkeyPatch
) -> None:
    thetas = [initial_theta(spec, seed) for seed in range(5)]
    built_kernel()
    frames = [measure(spec, theta) for theta in thetas]
    monkeypatch.setattr(compiled, "load", lambda: None)
    for theta, frame in zip(thetas, frames, strict=True):
        plain = measure(spec, theta)
        np.testing.assert_allclose([plain.low, plain.high], [frame.low, frame.high], atol=0.001 * frame.unit)


def test_box_of_a_known_function_is_exact() -> None:
    """Map x to (2 x, y, z / 2) + (1, 0, 0), as relu(x) - relu(-x): the box of the unit ball is known."""
    spec = MappingSpec("linear", 3, (6,), 3)
    factors = np.array([2, 1, 0.5], np.float32)
    w, v = np.concatenate([np.eye(3), -np.eye(3)]), np.concatenate([np.diag(factors), -np.diag(factors)], axis=1)
    theta = np.concatenate([w.ravel(), np.zeros(6), v.ravel(), [1, 0, 0]], dtype=np.float32)
    frame = measure(spec, theta)
    np.testing.assert_allclose(frame.low, [-1, -1, -0.5], atol=2e-3)
    np.testing.assert_allclose(frame.high, [3, 1, 0.5], atol=2e-3)


def test_box_of_a_word_is_that_of_its_composition() -> None:
    spec = MappingSpec("small", 3, (16,), 3, k=2)
    word = np.stack([initial_theta(spec, seed) for seed in range(2)])
    low, high = bounds(sample(spec, tuple(word), POINTS))
    frame = measure(spec, word)
    np.testing.assert_allclose([frame.low, frame.high], [low, high], atol=CLOSE * frame.unit)
    same = measure(spec, np.stack([word[0], word[0]]))
    assert same == measure(spec, word[0])


def test_sampler_with_a_frame_gives_framed_points_in_any_chunking() -> None:
    spec = HOF_1.with_k(2)
    theta = initial_theta(spec)
    frame = measure(spec, theta)
    framed, raw = (Sampler(spec, (theta, theta), each) for each in (frame, None))
    points = framed.points(40_000, scale=3)
    np.testing.assert_allclose(points, 3 * (raw.points(40_000) - frame.center) / frame.unit, atol=1e-5)
    np.testing.assert_array_equal(framed.points(100, offset=20_000, scale=3), points[20_000:20_100])
    assert np.ptp(points, axis=0).max() <= 3 * (1 + CLOSE)


@pytest.mark.parametrize("factor", [1e30, 1e35])
def test_examine_of_values_beyond_float32_raises_corrupt_weights(factor: float) -> None:
    spec = MappingSpec("small", 3, (16,), 3)
    theta = initial_theta(spec)
    examine(spec, Functions(theta))
    theta[-3:] = np.float32(factor)
    with pytest.raises(CorruptWeights, match="float32"):
        examine(spec, Functions(theta))


def test_examine_of_a_color_beyond_float32_raises_corrupt_weights() -> None:
    spec = MappingSpec("small", 3, (16,), 3)
    color = Color(spec, np.full(spec.size, 1e30, np.float32))
    with pytest.raises(CorruptWeights, match="color"):
        examine(spec, Functions(initial_theta(spec), color))
