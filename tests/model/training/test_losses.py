"""Chamfer distances, early and late, and the projection regularization."""

import numpy as np
import pytest
import torch

from model.networks.ops.nearest import nearest_index
from model.training.losses import BACKWARD, F_WEIGHT, SATURATION, chamfer, late_chamfer, nearest_projection, projection


def test_chamfer_is_the_sum_of_both_squared_directions() -> None:
    rng = np.random.default_rng(0)
    a, b = (torch.from_numpy(rng.random((2, n, 3), np.float32)) for n in (40, 60))
    squared = torch.cdist(a, b).square()
    assert (nearest_index(a, b) == squared.argmin(2)).all()
    assert float(chamfer(a, b)) == pytest.approx(float(squared.amin(2).mean() + squared.amin(1).mean()), rel=1e-5)


def test_chamfer_gradient_points_away_from_the_nearest_point() -> None:
    predicted = torch.tensor([[[0.0, 0, 0]]], requires_grad=True)
    chamfer(predicted, torch.tensor([[[1.0, 0, 0]]])).backward()  # type: ignore[no-untyped-call]
    assert predicted.grad is not None
    assert predicted.grad.tolist() == [[[-4, 0, 0]]]  # d/dx 2 (x - 1)^2 at 0


def test_projection_is_the_mean_squared_distance() -> None:
    predicted, canonical = torch.ones(2, 5, 3), torch.zeros(2, 5, 3)
    assert float(projection(predicted, canonical)) == 3


def test_late_chamfer_is_cd_epcg_with_a_saturating_term() -> None:
    rng = np.random.default_rng(0)
    a, b = (torch.from_numpy(rng.random((2, n, 3), np.float32)) for n in (40, 60))
    distances = torch.cdist(a, b)
    expected = sum(
        d.mean() + F_WEIGHT * (1 - (-d / SATURATION).exp()).mean() for d in (distances.amin(2), distances.amin(1))
    )
    assert float(late_chamfer(a, b)) == pytest.approx(float(expected), rel=1e-4)


def test_late_chamfer_of_many_true_points_matches_only_the_first_backward() -> None:
    rng = np.random.default_rng(0)
    a, b = (torch.from_numpy(rng.random((2, n, 3), np.float32)) for n in (10, 60))
    distances = torch.cdist(a, b)
    matched = distances.amin(1)[:, : BACKWARD * 10]
    expected = sum(d.mean() + F_WEIGHT * (1 - (-d / SATURATION).exp()).mean() for d in (distances.amin(2), matched))
    assert float(late_chamfer(a, b)) == pytest.approx(float(expected), rel=1e-4)


def test_late_chamfer_of_touching_clouds_has_finite_gradients() -> None:
    rng = np.random.default_rng(0)
    true = torch.from_numpy(rng.random((1, 30, 3), np.float32))
    predicted = true.clone()
    predicted[0, 0] += 1e-3
    predicted.requires_grad_()
    late_chamfer(predicted, true).backward()  # type: ignore[no-untyped-call]
    assert predicted.grad is not None
    assert torch.isfinite(predicted.grad).all()
    assert (predicted.grad[0, 1:] == 0).all()
    slope = 1 + F_WEIGHT / SATURATION * np.exp(-1e-3 * 3**0.5 / SATURATION)
    assert predicted.grad[0, 0].tolist() == pytest.approx([2 * slope / 30 / 3**0.5] * 3, rel=1e-3)


def test_late_chamfer_pulls_a_near_point_more_than_a_far_one() -> None:
    predicted = torch.tensor([[[0.005, 0, 0], [0.4, 0, 0]]], requires_grad=True)
    late_chamfer(predicted, torch.zeros(1, 1, 3)).backward()  # type: ignore[no-untyped-call]
    assert predicted.grad is not None
    near, far = predicted.grad[0, :, 0].tolist()
    assert near > 3 * far
    assert far == pytest.approx(0.5, rel=1e-3)  # far away, nothing but the unsquared distance is left


def test_nearest_projection_is_the_distance_to_the_true_point_nearest_to_the_start() -> None:
    canonical = torch.tensor([[[0.0, 0, 0], [1, 0, 0]]])
    true = torch.tensor([[[0.2, 0, 0], [3.0, 0, 0]]])
    predicted = torch.tensor([[[0.2, 0, 0], [0.2, 1, 0]]])
    assert float(nearest_projection(predicted, canonical, true)) == pytest.approx(0.5)  # 0 and 1
