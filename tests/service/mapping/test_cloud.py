import numpy as np
import pytest

from service.mapping.cloud import bounds


def test_bounds_of_chunks_are_those_of_all_points() -> None:
    chunks = [np.array([[1, 5, -2], [3, 4, 0]], np.float32), np.array([[-7, 4.5, 9]], np.float32)]
    low, high = bounds(iter(chunks))
    np.testing.assert_array_equal(low, [-7, 4, -2])
    np.testing.assert_array_equal(high, [3, 5, 9])
    assert low.dtype == high.dtype == np.float32


def test_bounds_of_no_points_raises_value_error() -> None:
    with pytest.raises(ValueError, match="not enough values"):
        bounds(iter(()))
