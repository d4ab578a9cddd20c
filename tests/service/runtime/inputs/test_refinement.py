"""Fitting a completed object to its points: the gradient, the distance to the part, what was not seen."""

import numpy as np
import pytest

from service.mapping import refinement
from service.mapping.canonical import canonical_points
from service.mapping.refinement import refine
from service.mapping.spec import HOF_1, Array, MappingSpec, initial_theta, power

SPECS = (
    MappingSpec("relu", 3, (16,), 3, k=2),
    MappingSpec("deep", 3, (8, 8), 3, k=1),
    MappingSpec("tanh", 3, (8,), 3, "tanh", 3, "cube"),
    MappingSpec("four", 4, (8,), 3, k=1, domain="ball4"),
)


def loss(spec: MappingSpec, theta: Array, canonical: Array, held: Array, part: Array) -> float:
    points = power(spec, theta, canonical)
    away = np.linalg.norm(points[:, None] - part, axis=2).min(axis=0)
    return float(away.mean() + refinement.HOLD * ((points - held) ** 2).sum(axis=1).mean())


@pytest.mark.parametrize("spec", SPECS, ids=lambda spec: spec.name)
def test_gradient_agrees_with_differences_of_the_loss(spec: MappingSpec) -> None:
    rng = np.random.default_rng(0)
    theta = initial_theta(spec, 1).astype(np.float64)
    canonical = canonical_points(spec.domain, 40).astype(np.float64)
    held, part = rng.normal(size=(40, 3)), rng.normal(size=(20, 3))
    gradient = refinement._gradient(spec, theta, canonical, held, part)  # type: ignore[arg-type]
    step = 1e-6
    for index in rng.choice(spec.size, 12, replace=False):
        moved = [theta.copy(), theta.copy()]
        moved[0][index] -= step
        moved[1][index] += step
        low, high = (loss(spec, each, canonical, held, part) for each in moved)  # type: ignore[arg-type]
        assert gradient[index] == pytest.approx((high - low) / (2 * step), abs=1e-5)


def test_refine_brings_the_object_to_the_part_and_leaves_the_rest() -> None:
    theta = initial_theta(HOF_1, 3)
    whole = power(HOF_1, theta, canonical_points("ball", 4_000, 1))
    middle = float(np.median(whole[:, 0]))
    part = whole[whole[:, 0] > middle] + np.array([0, 0.05, 0], np.float32)
    fitted = refine(HOF_1, theta, part)
    assert fitted.dtype == np.float32
    assert (fitted != theta).any()
    canonical = canonical_points("ball", 2_000, 2)
    before, after = power(HOF_1, theta, canonical), power(HOF_1, fitted, canonical)
    moved = np.linalg.norm(after - before, axis=1)
    mask = before[:, 0] > middle
    assert moved[~mask].mean() < 0.75 * moved[mask].mean()
    assert distance(part, after) < 0.6 * distance(part, before)


def test_refine_without_steps_returns_theta_as_it_is() -> None:
    theta = initial_theta(HOF_1, 3)
    np.testing.assert_array_equal(refine(HOF_1, theta, np.zeros((64, 3), np.float32), steps=0), theta)


def distance(part: Array, points: Array) -> float:
    return float(np.linalg.norm(part[:300, None] - points, axis=2).min(axis=1).mean())
