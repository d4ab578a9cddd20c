"""The frame of an object: centered, of length 1, and kept exactly."""

import numpy as np
import pytest

from service.errors import CorruptWeights
from service.mapping.frame import BYTES, Frame

FRAME = Frame.of(np.array([-0.1, -0.2, 1 / 3], np.float32), np.array([0.3, 1.1, 0.5], np.float32))


def test_frame_centers_the_box_and_makes_its_longest_side_one() -> None:
    corners = np.array([FRAME.low, FRAME.high], np.float32)
    framed = (corners - FRAME.center) * FRAME.factor()
    np.testing.assert_allclose(framed[1], -framed[0], atol=1e-7)
    assert np.ptp(framed, axis=0).max() == pytest.approx(1, abs=1e-7)
    np.testing.assert_allclose(np.ptp(framed, axis=0), FRAME.dimensions, atol=1e-6)
    assert max(FRAME.dimensions) == 1


@pytest.mark.parametrize("scale", [1e-9, 0.8, 1e9])
def test_frame_with_a_scale_makes_the_longest_side_that_long(scale: float) -> None:
    assert float(FRAME.factor(scale)) * FRAME.unit == pytest.approx(scale, rel=1e-7)


def test_frame_of_a_point_only_centers_it() -> None:
    corner = np.array([1, 2, 3], np.float32)
    point = Frame.of(corner, corner)
    assert (point.unit, point.dimensions) == (1, (0, 0, 0))
    np.testing.assert_array_equal(point.center, [1, 2, 3])


def test_frame_as_bytes_and_as_json_restores_the_same_numbers() -> None:
    assert len(FRAME.to_bytes()) == BYTES
    assert Frame.from_bytes(FRAME.to_bytes()) == Frame.from_json(FRAME.to_json()) == FRAME


@pytest.mark.parametrize("text", [None, 5, "", "null", '{"low": [0, 0, 0]}', '{"low": "abc", "high": [1, 1, 1]}'])
def test_frame_from_other_json_raises_corrupt_weights(text: object) -> None:
    with pytest.raises(CorruptWeights, match="frame"):
        Frame.from_json(text)
