"""Metrics of clouds with known distances, and bootstrap intervals."""

import numpy as np
import pytest

from model.metrics import NAMES, class_uniform, compare, floor, interval


def test_compare_of_a_shifted_cloud_gives_its_distances() -> None:
    true = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
    figures = compare(true + np.array([0.015, 0, 0], np.float32), true)
    assert tuple(figures) == NAMES
    assert figures["cd_forward"] == pytest.approx(1.5, rel=1e-4)
    assert figures["cd_backward"] == pytest.approx(1.5, rel=1e-4)
    assert figures["cd_sq"] == pytest.approx(2 * 100 * 0.015**2, rel=1e-4)
    assert (figures["f@1%"], figures["f@2%"], figures["f@5%"]) == (0, 1, 1)


def test_compare_of_a_part_gives_both_directions_and_its_f_score() -> None:
    true = np.array([[0, 0, 0], [1, 0, 0]], np.float32)
    figures = compare(true[:1], true)
    assert (figures["cd_forward"], figures["cd_backward"]) == (0, 50)
    assert figures["f@1%"] == pytest.approx(2 * 1 * 0.5 / 1.5)


def test_compare_of_two_clouds_gives_known_metrics() -> None:
    predicted = np.array([[0, 0, 0], [1, 0, 0]], np.float32)
    true = np.array([[0, 0, 0.015], [1, 0, 0], [1, 0, 0.5]], np.float32)
    figures = compare(predicted, true)
    assert figures["cd_forward"] == pytest.approx(100 * 0.015 / 2)
    assert figures["cd_backward"] == pytest.approx(100 * 0.515 / 3)
    assert figures["cd_sq"] == pytest.approx(100 * (0.015**2 / 2 + (0.015**2 + 0.25) / 3))
    assert figures["f@1%"] == pytest.approx(2 * 0.5 * (1 / 3) / (0.5 + 1 / 3))
    assert figures["f@2%"] == pytest.approx(2 * 1 * (2 / 3) / (1 + 2 / 3))
    assert compare(predicted, predicted + 9)["f@5%"] == 0


def test_floor_is_the_metrics_of_a_fresh_sample() -> None:
    sphere = np.random.default_rng(0).standard_normal((2, 10_000, 3))
    first, second = (sphere / np.linalg.norm(sphere, axis=2, keepdims=True) / 2).astype(np.float32)
    expected, estimate = compare(second, first), floor(first)
    for name in NAMES:
        assert estimate[name] == pytest.approx(expected[name], rel=0.03), name


def test_interval_holds_the_mean_and_narrows_with_more_objects() -> None:
    values = np.random.default_rng(1).normal(3, 1, 400)
    mean, low, high = interval(values)
    assert mean == pytest.approx(values.mean())
    assert low < mean < high
    assert high - low == pytest.approx(2 * 1.96 * values.std() / 20, rel=0.1)
    wide = interval(values[:25])
    assert wide[2] - wide[1] > 2 * (high - low)


def test_interval_of_paired_differences_is_narrow() -> None:
    hard = np.random.default_rng(2).normal(5, 2, 60)
    gap = interval(hard + 0.2 - hard)
    assert gap[1:] == pytest.approx((0.2, 0.2))


def test_class_uniform_weighs_classes_alike() -> None:
    values, classes = np.array([1.0, 1, 1, 5]), ["chair", "chair", "chair", "bed"]
    assert class_uniform(values, classes) == (3, 3, 3)  # each class is constant: nothing to resample
    assert interval(values)[0] == 2
    low, high = class_uniform(np.array([0.0, 2, 4, 5]), classes)[1:]
    assert low < 3.5 < high
