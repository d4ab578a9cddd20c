"""The nearest point by a grid, against a k-d tree."""

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from model.networks.ops.nearest import nearest_index


@pytest.mark.parametrize("spread", [0.001, 0.05, 0.3, 2.0])  # of the queries; most of the last lie outside the grid
@pytest.mark.parametrize("scale", [0.1, 1.0, 4.0])  # of the targets; most of the last lie outside the grid
@pytest.mark.parametrize(("n", "m"), [(1, 1), (500, 7), (300, 5_000)])
def test_nearest_gives_the_distances_of_a_tree(n: int, m: int, scale: float, spread: float) -> None:
    rng = np.random.default_rng(0)
    targets = (rng.random((2, m, 3), np.float32) - 0.5) * np.float32(scale)
    near = targets[:, rng.integers(m, size=n)]
    queries = near + rng.normal(0, spread, near.shape).astype(np.float32)
    indices = nearest_index(torch.from_numpy(queries), torch.from_numpy(targets)).numpy()
    for cloud, others, index in zip(queries, targets, indices, strict=True):
        distances = np.linalg.norm(cloud - others[index], axis=1)
        assert distances == pytest.approx(cKDTree(others).query(cloud)[0], abs=1e-6)


def test_nearest_of_points_on_cell_borders_is_themselves() -> None:
    axis = np.linspace(-0.5, 0.5, 9, dtype=np.float32)
    cloud = torch.from_numpy(np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(1, -1, 3))
    assert nearest_index(cloud, cloud).tolist() == [list(range(cloud.shape[1]))]
