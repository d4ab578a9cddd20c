"""Points sampled on a surface."""

import numpy as np
import pytest
import trimesh

from model.data.rendering.surface import sample_surface


def test_sample_surface_two_boxes_follows_area() -> None:
    big, small = trimesh.creation.box(extents=(1, 1, 1)), trimesh.creation.box(extents=(0.5, 0.5, 0.5))
    small.apply_translation((3, 0, 0))
    points, _ = sample_surface([big, small], 20_000, np.random.default_rng(0))
    assert (points[:, 0] > 2).mean() == pytest.approx(0.2, abs=0.01)
