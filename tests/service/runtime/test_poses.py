"""Poses: objects before cameras whose pictures are known."""

import numpy as np
import numpy.typing as npt
import pytest

from service.encoding.estimates import Camera, Estimates
from service.encoding.report import ImageReport
from service.errors import InvalidParameter
from service.mapping.box import measure
from service.mapping.pose import Pose
from service.mapping.sampler import Sampler
from service.mapping.spec import Array, Functions, initial_theta, word_of
from service.runtime.options import MeshOptions, PathOptions, PointOptions
from service.runtime.poses import POSE_POINTS, View, pose_of, view_of
from service.runtime.shapes import mesh_of
from tests.support.small.model import SPEC

THETA = initial_theta(SPEC, 5)
FRAME = measure(SPEC, THETA)
PHOTO = ImageReport("alpha", (40, 12, 480, 502), 1.0, 640, 512)
CAMERA = Camera(azimuth=30.0, elevation=20.0, distance=2.5, roll=5.0)

Doubles = npt.NDArray[np.float64]


def _points(pose: Pose, scale: float = 1.0) -> Doubles:
    points: Array = Sampler(SPEC, word_of(SPEC, THETA), FRAME).points(POSE_POINTS, sampling="sobol", scale=scale)
    return pose.place(points, scale).astype(np.float64)


def _pixels(points: Doubles, focal: float, middle: tuple[float, float]) -> Doubles:
    return points[:, :2] / points[:, 2:] * focal + middle


def _box(pixels: Doubles) -> tuple[float, float, float, float]:
    (left, top), (right, bottom) = pixels.min(axis=0), pixels.max(axis=0)
    return float(left), float(top), float(right), float(bottom)


def _pose(view: View) -> Pose:
    pose = pose_of(view, SPEC, Functions(THETA), FRAME)
    assert pose is not None
    return pose


@pytest.mark.parametrize(
    ("azimuth", "elevation", "roll", "point", "expected"),
    [
        (0, 0, 0, (0.1, 0.2, 0.3), (0.1, -0.2, 2.7)),  # in front: x right, y down, z forward
        (90, 0, 0, (0.1, 0.2, 0.3), (-0.3, -0.2, 2.9)),  # at +X: the front is at its left
        (180, 0, 0, (0.1, 0.2, 0.3), (-0.1, -0.2, 3.3)),
        (0, 90, 0, (0.1, 0.2, 0.3), (0.1, 0.3, 2.8)),  # above: the front is at the bottom
        (0, 0, 90, (0.1, 0.2, 0.3), (-0.2, -0.1, 2.7)),  # turned clockwise: the picture turns the other way
    ],
)
def test_pose_without_a_photo_looks_at_the_center(
    azimuth: float, elevation: float, roll: float, point: tuple[float, ...], expected: tuple[float, ...]
) -> None:
    options = PointOptions(frame="camera", azimuth=azimuth, elevation=elevation, distance=3, roll=roll)
    view = view_of(options, None, None)
    assert view
    placed = _pose(view).place(np.array([point], np.float32), 1.0)
    np.testing.assert_allclose(placed, [expected], atol=1e-6)


def test_pose_is_a_rotation() -> None:
    pose = _pose(View(CAMERA, PHOTO.box, (600.0, 600.0), (320.0, 256.0)))
    rotation = np.array(pose.rotation)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
    assert np.linalg.det(rotation) == pytest.approx(1)


@pytest.mark.parametrize("focal", [(300.0, 300.0), (900.0, 900.0), (700.0, 650.0)])
def test_pose_with_a_focal_length_fills_the_box_of_the_photo(focal: tuple[float, float]) -> None:
    pose = _pose(View(Camera(30.0, 20.0, 0.0, 5.0), (410.0, 300.0, 560.0, 480.0), focal, (320.0, 240.0)))
    points = _points(pose)
    pixels = points[:, :2] / points[:, 2:] * focal + (320.0, 240.0)
    left, top, right, bottom = _box(pixels)
    assert ((left + right) / 2, (top + bottom) / 2) == pytest.approx((485, 390), abs=0.5)
    sides = (right - left, bottom - top)
    assert max(sides) == pytest.approx(180, rel=0.01)


@pytest.mark.parametrize("distance", [1.2, 2.5, 6.0])
def test_pose_of_a_true_camera_is_found_from_its_photo(distance: float) -> None:
    true = _pose(View(Camera(30.0, 20.0, distance, 5.0)))
    focal, middle = 500.0, (320.0, 240.0)
    box = _box(_pixels(_points(true), focal, middle))
    match = _pose(View(Camera(30.0, 20.0, 0.0, 5.0), box, (focal, focal), middle))
    np.testing.assert_allclose(match.position, true.position, atol=0.01 * distance)


def test_pose_without_a_focal_length_keeps_the_distance_and_the_direction() -> None:
    pose = _pose(View(CAMERA, (410.0, 300.0, 560.0, 480.0), None, (320.0, 240.0)))
    assert np.linalg.norm(pose.position) == pytest.approx(2.5)
    x, y, _ = pose.position
    assert x > 0
    assert y > 0
    centered = _pose(View(CAMERA, (220.0, 140.0, 420.0, 340.0), None, (320.0, 240.0)))
    assert np.linalg.norm(centered.position[:2]) < 0.3


def test_pose_places_points_in_the_unit_of_scale() -> None:
    pose = _pose(View(CAMERA, PHOTO.box, (600.0, 600.0), (320.0, 256.0)))
    np.testing.assert_allclose(_points(pose, 0.8), 0.8 * _points(pose), rtol=1e-5, atol=1e-5)


def test_surface_in_the_camera_frame_keeps_its_shape_and_its_outside() -> None:
    pose = _pose(View(CAMERA, PHOTO.box, None, (320.0, 256.0)))
    plain = mesh_of(SPEC, Functions(THETA), FRAME, MeshOptions(resolution=16, scale=2))
    turned = mesh_of(SPEC, Functions(THETA), FRAME, MeshOptions(resolution=16, scale=2, frame="camera"), pose)
    np.testing.assert_array_equal(plain.triangles, turned.triangles)
    np.testing.assert_allclose(np.linalg.norm(turned.normals, axis=1), 1, atol=1e-5)
    plane = (plain.vertices[plain.triangles[:, 0]] * plain.normals[plain.triangles[:, 0]]).sum(axis=1)
    moved = turned.vertices - 2 * np.array(pose.position, np.float32)
    np.testing.assert_allclose(
        (moved[plain.triangles[:, 0]] * turned.normals[plain.triangles[:, 0]]).sum(1), plane, atol=1e-4
    )


def test_view_takes_what_the_options_lack_from_the_estimates() -> None:
    view = view_of(PointOptions(frame="camera", roll=0), Estimates(0.5, CAMERA), PHOTO)
    assert view == View(Camera(30.0, 20.0, 2.5, 0.0), PHOTO.box, None, (320.0, 256.0))
    view = view_of(MeshOptions(frame="camera", fx=700, cx=300), Estimates(0.5, CAMERA), PHOTO)
    assert view == View(Camera(30.0, 20.0, 0.0, 5.0), PHOTO.box, (700.0, 700.0), (300.0, 256.0))


def test_view_of_another_frame_is_none() -> None:
    assert view_of(PointOptions(), Estimates(0.5, CAMERA), PHOTO) is None
    assert "camera" not in str(PathOptions.model_json_schema()["properties"]["frame"].get("enum"))


@pytest.mark.parametrize(
    ("values", "has_photo", "field", "message"),
    [
        ({"azimuth": 1}, True, "azimuth", "azimuth needs frame=camera"),
        ({"fx": 1, "frame": "raw"}, True, "fx", "fx needs frame=camera"),
        ({"frame": "camera"}, True, "azimuth", "give azimuth, elevation, distance"),
        ({"frame": "camera", "azimuth": 1, "elevation": 1}, True, "distance", "give azimuth, elevation, distance"),
        ({"frame": "camera", "azimuth": 1, "fx": 500}, True, "elevation", "give azimuth, elevation"),
        ({"frame": "camera", "azimuth": 1, "elevation": 1, "fx": 500}, False, "fx", "fx needs a photo"),
        ({"frame": "camera", "azimuth": 1, "elevation": 1, "distance": 2, "cy": 5}, True, "cy", "cy needs fx"),
    ],
)
def test_view_of_an_incomplete_camera_raises(
    values: dict[str, float | str], has_photo: bool, field: str, message: str
) -> None:
    with pytest.raises(InvalidParameter, match=message) as caught:
        view_of(PointOptions.model_validate(values), None, PHOTO if has_photo else None)
    assert caught.value.field == field
