"""Clouds in the camera's frame: as the picture shows them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model.data.augment import WHITE_LIGHT
from model.data.dataset import Examples, Shape, draw_batch
from model.data.rendering.camera_frame import to_camera
from model.data.sources.photographs import photograph_files
from service.drawing.cloud import camera_axes
from tests.support.small.network import CONFIG


@pytest.mark.parametrize(("azimuth", "elevation"), [(0.0, 0.0), (90.0, 0.0), (37.0, 21.0), (250.0, -10.0)])
def test_to_camera_has_right_up_and_toward_as_its_axes(azimuth: float, elevation: float) -> None:
    points = np.random.default_rng(0).normal(size=(5, 3)).astype(np.float32)
    turned = to_camera(torch.from_numpy(points)[None], torch.tensor([[azimuth, elevation]]))[0].numpy()
    toward, right, up = camera_axes(azimuth, elevation)
    np.testing.assert_allclose(turned, np.stack([points @ right, points @ up, points @ toward], axis=1), atol=1e-5)


def test_draw_batch_in_the_cameras_frame_mirrors_right_and_left() -> None:
    points = np.full((10, 3), [0.1, 0.2, 0.4], np.float32)
    crops = np.full((2, 64, 64, 4), 255, np.uint8)
    shape = Shape(crops, points, None, np.array([[90, 0], [90, 0]], np.float32))
    config = replace(CONFIG, frame="camera", batch=1, points=4, target_points=3)
    examples = Examples([], [[shape]], photograph_files(Path("no folder")))
    signs = set()
    for step in range(20):
        x, y, z = draw_batch(examples, config, step, WHITE_LIGHT).points[0, 0].tolist()
        assert (abs(x), y, z) == (pytest.approx(0.4), pytest.approx(0.2), pytest.approx(0.1))
        signs.add(np.sign(x))
    assert signs == {1.0, -1.0}


def test_points_in_the_cameras_frame_without_cameras_raise_value_error() -> None:
    shape = Shape(np.zeros((1, 4, 4, 4), np.uint8), np.zeros((2, 3), np.float32))
    with pytest.raises(ValueError, match="--frame camera needs"):
        shape.points_in("camera", 0)
