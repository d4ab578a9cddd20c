"""Pictures of points: position, occlusion, color and shading."""

import numpy as np
import pytest

from service.drawing.cloud import EXTENT, FAR, GROUND, NEAR, WIDEST, camera_axes, draw

SIZE = 145  # a hundred pixels a unit


def drawn(*points: tuple[float, float, float], azimuth: float = 0, elevation: float = 0) -> dict[tuple[int, int], int]:
    """(row, column) -> red of the pixels that are not ground; its edges are mixed with the ground."""
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
def test_draw_of_a_point_puts_it_where_the_camera_looks(
    point: tuple[float, float, float], azimuth: float, elevation: float, pixel: tuple[int, int]
) -> None:
    places = np.array(list(drawn(point, azimuth=azimuth, elevation=elevation)))
    assert np.abs(places.mean(axis=0) - pixel).max() <= 1
    assert np.abs(places - pixel).max() <= 1 + SIZE * WIDEST


def test_draw_in_any_order_lets_the_nearer_point_hide_the_other() -> None:
    near, far = (0.0, 0.0, 0.6), (0.0, 0.0, -0.6)
    alone = drawn(near)
    assert drawn(near, far) == drawn(far, near) == alone
    assert min(drawn(far).values()) > min(alone.values())  # the far one is lighter
    assert NEAR[0] <= min(alone.values()) <= FAR[0]


def test_draw_with_colors_dims_far_points() -> None:
    points = np.array([[-0.3, 0, 0.7], [0.3, 0, -0.7]], np.float32)
    colors = np.array([[200, 100, 0], [200, 100, 0]], np.uint8)
    image = draw(points, SIZE, 0, 0, colors)
    assert {tuple(pixel) for pixel in image[image[..., 2] == 0].tolist()} == {(200, 100, 0), (140, 70, 0)}


def test_draw_of_points_beyond_the_frame_leaves_them_out() -> None:
    assert drawn((EXTENT, 0, 0), (0, -EXTENT, 0)) == {}


def test_draw_scales_discs_with_picture_size_and_number_of_points() -> None:
    def area(points: int, size: int) -> float:
        light = draw(np.zeros((points, 3), np.float32), size)[..., 0].astype(float)
        return float((GROUND - light).sum() / (GROUND - light.min()))

    assert area(1, 640) == pytest.approx(np.pi * (640 * WIDEST) ** 2, rel=0.1)
    assert area(1, 320) == pytest.approx(np.pi * (320 * WIDEST) ** 2, rel=0.1)
    assert area(1_000_000, 320) <= 1


def test_draw_behind_an_edge_is_darker() -> None:
    """A plate before another's left half: only the other's rim beside it is shaded."""
    across, along = (each.ravel() for each in np.meshgrid(*[np.linspace(-0.5, 0.5, 300)] * 2))
    far = np.stack([across, along, np.full_like(across, -0.2)], axis=1)
    near = np.stack([across * 0.5 - 0.25, along, np.zeros_like(across)], axis=1)
    gray = np.full((2 * len(across), 3), 200, np.uint8)
    row = draw(np.concatenate([far, near]).astype(np.float32), SIZE, 0, 0, gray)[SIZE // 2, :, 0].astype(int)
    left, rim, right = row[30:66], row[73:76], row[90:118]
    assert np.ptp(left) == np.ptp(right) == 0
    assert rim.max() < 0.85 * right[0] < left[0]
    assert (row[np.r_[0:18, 128:SIZE]] == GROUND).all()


def test_camera_axes_any_angle_is_a_right_handed_frame() -> None:
    toward, right, up = camera_axes(0, 0)
    assert toward.tolist() == [0, 0, 1]
    assert right.tolist() == [1, 0, 0]
    assert up.tolist() == [0, 1, 0]
    toward, right, up = camera_axes(77, 31)
    assert np.stack([right, up, toward]) @ np.stack([right, up, toward]).T == pytest.approx(np.eye(3), abs=1e-6)
