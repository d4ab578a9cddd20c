"""The nearest of many objects, against a search that compares them all."""

import numpy as np
import pytest

from model.evaluation.references.neighbors import Neighbors
from model.metrics import nearest_distances
from tests.support.small import data as small_data

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def clouds() -> np.ndarray[tuple[int, ...], np.dtype[np.float32]]:
    return np.stack([small_data.box(number, 500) for number in range(30)])


@pytest.mark.parametrize("scale", [0.2, 0.9, 1.0, 3.0])  # 3: most of it lies outside the grid
@pytest.mark.parametrize("number", [3, 40, 41, 42])
def test_distance_any_cloud_equals_an_exhaustive_search(
    clouds: np.ndarray[tuple[int, ...], np.dtype[np.float32]], number: int, scale: float
) -> None:
    cloud = small_data.box(number, 400) * np.float32(scale) + np.float32(0.02)
    expected = min(nearest_distances(cloud, other).mean() + nearest_distances(other, cloud).mean() for other in clouds)
    assert Neighbors(clouds).distance(cloud) == pytest.approx(expected, rel=1e-6)
