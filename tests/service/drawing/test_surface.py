"""Pictures of surfaces: position, occlusion, light, color and shadow."""

import tracemalloc

import numpy as np
import pytest

from service.drawing import surface as drawing
from service.drawing.cloud import EXTENT, FAR, GROUND, NEAR
from service.drawing.surface import draw_surface
from service.mapping.surface import Surface, icosphere

SIZE = 145  # a hundred pixels a unit


def _plate(z: float, half: float = 0.3, color: tuple[int, int, int] | None = None, facing: float = 1) -> Surface:
    """Return a square before the front camera."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32) * half + (0, 0, z)
    normals = np.tile(np.array([0, 0, facing], np.float32), (4, 1))
    colors = None if color is None else np.tile(np.array(color, np.uint8), (4, 1))
    return Surface(corners.astype(np.float32), np.array([[0, 1, 2], [0, 2, 3]], np.uint32), normals, colors)


def _ball(radius: float, resolution: int = 16) -> Surface:
    points, triangles = icosphere(resolution)
    return Surface(points * np.float32(radius), triangles, points)


def _together(*surfaces: Surface) -> Surface:
    offsets = np.cumsum([0] + [len(each.vertices) for each in surfaces])[:-1]
    triangles = [each.triangles + np.uint32(offset) for each, offset in zip(surfaces, offsets, strict=True)]
    colors = [each.colors for each in surfaces if each.colors is not None]
    return Surface(
        np.concatenate([each.vertices for each in surfaces]),
        np.concatenate(triangles),
        np.concatenate([each.normals for each in surfaces]),
        np.concatenate(colors) if colors else None,
    )


def test_draw_surface_of_a_plate_fills_its_place_and_no_more() -> None:
    image = draw_surface(_plate(0), SIZE, 0, 0)
    inked = (image < GROUND).any(axis=2)
    rows, columns = np.nonzero(inked)
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (42, 102, 42, 102)
    assert inked.sum() == 61**2
    assert FAR.min() * 0.5 < image[72, 72].min() < NEAR.max()


def test_draw_surface_in_any_order_lets_the_nearer_hide_the_other() -> None:
    red, blue = _plate(0.3, 0.2, (200, 0, 0)), _plate(-0.3, 0.2, (0, 0, 200))
    for pair in ((red, blue), (blue, red)):
        image = draw_surface(_together(*pair), SIZE, 0, 0).astype(int)
        assert image[72, 72, 0] > image[72, 72, 2] + 100
        image = draw_surface(_together(*pair), SIZE, 180, 0).astype(int)
        assert image[72, 72, 2] > image[72, 72, 0] + 100


def test_draw_surface_lights_both_sides_alike() -> None:
    front, back = (draw_surface(_plate(0, facing=facing), SIZE, 0, 0) for facing in (1, -1))
    assert (front == back).all()


@pytest.mark.parametrize("level", [0, 255])
def test_draw_surface_of_a_black_or_white_ball_shows_its_shape(level: int) -> None:
    ball = _ball(0.4)
    painted = Surface(ball.vertices, ball.triangles, ball.normals, np.full((len(ball.vertices), 3), level, np.uint8))
    image = draw_surface(painted, SIZE, 0, 0)[..., 0].astype(int)
    inside = image[45:100, 45:100]
    assert np.ptp(inside) > 10
    assert inside[:20].mean() > inside[-20:].mean()  # light from above


def test_draw_surface_stands_on_its_shadow_seen_from_above_alone() -> None:
    below = draw_surface(_ball(0.3), SIZE, 0, 30)[110:, 72].astype(int)
    assert (below < GROUND - 10).any()
    assert (below == below[:, :1]).all()  # gray
    assert (draw_surface(_ball(0.3), SIZE, 0, 0)[110:] == GROUND).all()
    assert (draw_surface(_ball(0.3), SIZE, 0, 30)[0] == GROUND).all()


def test_draw_surface_of_nothing_is_the_ground() -> None:
    nothing = Surface(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.uint32), np.zeros((0, 3), np.float32))
    assert (draw_surface(nothing, 32) == GROUND).all()


def test_draw_surface_beyond_the_frame_is_cut() -> None:
    assert (draw_surface(_plate(0, EXTENT), SIZE, 0, 0) < GROUND).any(axis=2).all()


def test_draw_surface_of_triangles_that_each_span_the_picture_takes_bounded_memory() -> None:
    """Weights from elsewhere may map neighbors anywhere."""
    vertices = np.random.default_rng(0).uniform(-0.5, 0.5, (9_000, 3)).astype(np.float32)
    triangles = np.random.default_rng(1).integers(0, 9_000, (20_000, 3)).astype(np.uint32)
    chaos = Surface(vertices, triangles, vertices)
    tracemalloc.start()
    try:
        image = draw_surface(chaos, 256, 0, 0)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert (image < GROUND).any()
    assert peak < 100e6


def test_hidden_layers_are_not_drawn_and_change_nothing() -> None:
    layers = _together(*(_ball(radius) for radius in (0.2, 0.3, 0.35, 0.4)))
    kept = drawing._without_hidden(layers.vertices, layers.triangles, drawing.COARSE)
    assert len(kept) < len(layers.triangles) / 4
    alone = draw_surface(_ball(0.4), SIZE, 0, 0)
    assert (draw_surface(layers, SIZE, 0, 0) == alone).mean() > 0.995


def test_pixels_of_triangles_are_those_whose_middles_they_hold() -> None:
    """The same by testing every pixel against every triangle."""
    viewed = np.random.default_rng(7).uniform(-0.8, 0.8, (30, 3)).astype(np.float32)
    triangles = np.arange(30, dtype=np.uint32).reshape(10, 3)
    raster = drawing._rasterize(viewed, triangles, 60)
    places = drawing._places(viewed, 60).astype(np.float64)
    expected = np.full(3600, -1)
    y, x = np.divmod(np.arange(3600), 60)
    for number, corners in enumerate(places[triangles]):
        sides = []
        for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            sides.append((bx - ax) * (y - ay) - (by - ay) * (x - ax))
        inside = (np.array(sides) >= 0).all(axis=0) | (np.array(sides) <= 0).all(axis=0)
        expected[inside] = number
    assert (raster.pixels == np.flatnonzero(expected >= 0)).all()
    assert (raster.corners[:, 0] // 3 == expected[raster.pixels]).all()
    assert raster.weights.sum(axis=1) == pytest.approx(1, abs=1e-4)
    assert raster.mean(drawing._places(viewed, 60))[:, 0] == pytest.approx(x[raster.pixels], abs=1e-2)
