"""The lines of docs/api.md that lay an object over its photo."""

import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.project.documents import text_of

BOX = (100, 50, 300, 150)
AXES = np.array([[0.5, 0, 0], [-0.5, 0, 0], [0, 0.5, 0], [0, -0.5, 0], [0, 0, 0.5], [0, 0, -0.5]])  # ends of +-X, Y, Z


@pytest.fixture
def over_photo() -> Callable[..., np.ndarray[Any, np.dtype[np.float64]]]:
    blocks = re.findall(r"^```python\n(.*?)^```", text_of("docs/api.md"), re.MULTILINE | re.DOTALL)
    (block,) = [block for block in blocks if "def over_photo" in block]
    names: dict[str, Any] = {}
    exec(block, names)
    function: Callable[..., np.ndarray[Any, np.dtype[np.float64]]] = names["over_photo"]
    return function


def _camera(azimuth: float = 0, elevation: float = 0, roll: float = 0) -> dict[str, float]:
    return {"azimuth": azimuth, "elevation": elevation, "distance": 3, "roll": roll}


def test_over_photo_fills_the_box(over_photo: Callable[..., np.ndarray[Any, np.dtype[np.float64]]]) -> None:
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (1_000, 3)) * (1, 0.4, 0.7)
    pixels = over_photo(points, _camera(30, 20, 5), BOX)
    sides = np.ptp(pixels, axis=0)
    assert (pixels.max(axis=0) + pixels.min(axis=0)) / 2 == pytest.approx([200, 100])
    assert max(sides) == pytest.approx(200)


def test_over_photo_follows_the_angles(over_photo: Callable[..., np.ndarray[Any, np.dtype[np.float64]]]) -> None:
    right, left, top, bottom, front, back = over_photo(AXES, _camera(), BOX)
    assert right[0] > front[0] > left[0]  # from the front +X is on the right of the photo
    assert bottom[1] > front[1] > top[1]
    right, left, top, bottom, front, back = over_photo(AXES, _camera(azimuth=90), BOX)
    assert back[0] > right[0] > front[0]  # from the side at +X the front is on the left
    right, left, top, bottom, front, back = over_photo(AXES, _camera(elevation=30), BOX)
    assert front[1] > back[1]  # from above what is near is lower
    right, left, top, bottom, front, back = over_photo(AXES, _camera(roll=10), BOX)
    assert top[0] < bottom[0]  # the camera is turned clockwise, the photo shows the object turned the other way
