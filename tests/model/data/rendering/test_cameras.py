"""Random cameras around an object."""

import math

import numpy as np
import pytest

from model.data.rendering.cameras import free_cameras


def test_free_cameras_both_splits_keep_to_their_ranges() -> None:
    held = free_cameras(2_000, False, np.random.default_rng(0))
    train = free_cameras(2_000, True, np.random.default_rng(0))
    assert held.min(axis=0) == pytest.approx([0, 0, 1.3, 0], abs=0.5)
    assert held.max(axis=0) == pytest.approx([360, 45, 6, 0], abs=0.5)
    assert np.median(held[:, 2]) == pytest.approx(math.sqrt(1.3 * 6), rel=0.05)
    assert (train[:, 1].min(), train[:, 1].max()) == pytest.approx((-5, 55), abs=0.5)
    assert train[:, 3].std() == pytest.approx(2, rel=0.05)
