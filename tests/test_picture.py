"""Pictures of points: where a point lands, which one hides which, what a camera sees."""

import numpy as np
import pytest

from service.picture import EXTENT, FAR, GROUND, NEAR, draw

SIZE = 145  # a hundred pixels a unit


def drawn(*points: tuple[float, float, float], azimuth: float = 0, elevation: float = 0) -> dict[tuple[int, int], int]:
    """(row, column) -> red of the pixels that are not ground."""
    image = draw(np.array(points, np.float32), SIZE, azimuth, elevation)
    rows, columns = np.nonzero((image != GROUND).any(axis=2))
    return {(int(r), int(c)): int(image[r, c, 0]) for r, c in zip(rows, columns, strict=True)}


@pytest.mark.parametrize(
    ("point", "azimuth", "elevation", "pixel"),
    [
        ((0.3, 0.2, 0), 0, 0, (52, 102)),  # from the front: +X right, +Y up
        ((0, 0.2, 0.3), 90, 0, (52, 42)),  # from +X: +Z is left
        ((0.3, 0, 0), 180, 0, (72, 42)),
        ((0.3, 0, 0.2), 0, 90, (92, 102)),  # from above: +Z is down
    ],
)
def test_a_point_lands_where_the_camera_sees_it(
    point: tuple[float, float, float], azimuth: float, elevation: float, pixel: tuple[int, int]
) -> None:
    ((row, column),) = drawn(point, azimuth=azimuth, elevation=elevation)
    assert abs(row - pixel[0]) <= 1
    assert abs(column - pixel[1]) <= 1


def test_the_nearer_point_hides_the_other_whatever_their_order() -> None:
    near, far = (0.0, 0.0, 0.6), (0.0, 0.0, -0.6)
    alone = drawn(near)
    assert drawn(near, far) == drawn(far, near) == alone
    assert next(iter(drawn(far).values())) > next(iter(alone.values()))  # the far one is lighter
    assert NEAR[0] <= next(iter(alone.values())) <= FAR[0]


def test_points_are_drawn_in_their_colours_far_ones_dimmer() -> None:
    points = np.array([[-0.3, 0, 0.7], [0.3, 0, -0.7]], np.float32)
    colors = np.array([[200, 100, 0], [200, 100, 0]], np.uint8)
    image = draw(points, SIZE, 0, 0, colors)
    assert {tuple(pixel) for pixel in image[(image != GROUND).any(axis=2)].tolist()} == {(200, 100, 0), (140, 70, 0)}


def test_points_beyond_the_frame_are_left_out() -> None:
    assert drawn((EXTENT, 0, 0), (0, -EXTENT, 0)) == {}


def test_points_grow_with_the_picture() -> None:
    assert (draw(np.zeros((1, 3), np.float32), 640) != GROUND).any(axis=2).sum() == 25
