"""The pose of an object before the camera of its photo: from the model's estimate, or from what a request gives.

The camera of an estimate looks at the object's center. In its photo the object may be anywhere, so the photo's box
decides the direction, and with the focal length the distance, too. Without a focal length, that one is assumed with
which the object, at the camera's distance, fills its box.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from service.drawing.cloud import camera_axes
from service.encoding.estimates import Camera, Estimates
from service.encoding.report import ImageReport
from service.errors import InvalidParameter
from service.mapping.frame import Frame
from service.mapping.pose import Pose
from service.mapping.sampler import Sampler
from service.mapping.spec import Functions, MappingSpec, word_of
from service.runtime.options import DISTANCES, CameraOptions

POSE_POINTS: Final = 2_048  # of the object, which have to fill its box in the photo
ROUNDS: Final = 6  # of correcting direction and distance in turn
HALVINGS: Final = 40  # of the interval in which the distance lies
SMALLEST: Final = 1e-9  # extent of a projection: that of a single point is 0
NEAREST: Final = 0.01  # longest sides, from the camera to the object's nearest point
FORWARD: Final = np.array([0.0, 0.0, 1.0])

Doubles = npt.NDArray[np.float64]


@dataclass(frozen=True)
class View:
    """A camera, and the object's place in its photo.

    camera : angles of the camera that looks at the object; its distance is 0 if the photo decides it.
    box : left, top, right, bottom of the object, pixels; None without a photo: the camera looks at the center.
    focal : focal lengths in pixels, across and down; None if they are assumed.
    middle : pixel at which the camera itself looks.
    """

    camera: Camera
    box: tuple[float, float, float, float] | None = None
    focal: tuple[float, float] | None = None
    middle: tuple[float, float] = (0.0, 0.0)


def view_of(options: CameraOptions, estimates: Estimates | None, photo: ImageReport | None) -> View | None:
    """Return the view that options ask for; None if they ask for another frame than the camera's.

    Parameters
    ----------
    estimates, photo : of the object, if it has them; the options win.

    Raises
    ------
    InvalidParameter : a camera without `frame=camera`, or not enough of it; a focal length without a photo.
    """
    values = {name: getattr(options, name) for name in CameraOptions.model_fields}
    first = next((name for name, value in values.items() if value is not None), None)
    if getattr(options, "frame", None) != "camera":
        if first:
            raise InvalidParameter(f"{first} needs frame=camera: without it there is no camera", field=first)
        return None
    if options.fx is None:
        lone = next((name for name in ("fy", "cx", "cy") if values[name] is not None), None)
        if lone:
            raise InvalidParameter(f"{lone} needs fx, the focal length in pixels", field=lone)
    elif photo is None:
        raise InvalidParameter("fx needs a photo, and the object has none: give distance instead", field="fx")
    camera = _camera(options, estimates)
    if photo is None:
        return View(camera)
    middle = (_first(options.cx, photo.width / 2), _first(options.cy, photo.height / 2))
    focal = None if options.fx is None else (options.fx, _first(options.fy, options.fx))
    return View(camera, photo.box, focal, middle)


def pose_of(view: View | None, spec: MappingSpec, functions: Functions, frame: Frame) -> Pose | None:
    """Return the pose of an object in a view; None without a view. Raises CorruptWeights."""
    if view is None:
        return None
    facing = _facing(view.camera)
    if view.box is None:
        return _pose(facing, FORWARD * view.camera.distance)
    sampler = Sampler(spec, word_of(spec, functions.theta), frame)
    points = sampler.points(POSE_POINTS, sampling="sobol").astype(np.float64) @ facing.T
    rotation, distance = _fit(view, view.box, points)
    return _pose(rotation @ facing, rotation @ FORWARD * distance)


def _camera(options: CameraOptions, estimates: Estimates | None) -> Camera:
    """Return the camera of the options, completed by the estimate. Raises InvalidParameter if a part is missing."""
    default = estimates.camera if estimates else None
    needed = ["azimuth", "elevation"] + ["distance"] * (options.fx is None)
    if default is None:
        missing = next((name for name in needed if getattr(options, name) is None), None)
        if missing:
            raise InvalidParameter(
                f"the object has no camera, because no model estimated one: give {', '.join(needed)}", field=missing
            )
        default = Camera(0.0, 0.0, 0.0, 0.0)
    # With a focal length, the size in the photo decides the distance, unless the request gives it.
    distance = 0.0 if options.fx is not None else default.distance
    return Camera(
        _first(options.azimuth, default.azimuth),
        _first(options.elevation, default.elevation),
        _first(options.distance, distance),
        _first(options.roll, default.roll),
    )


def _fit(view: View, box: tuple[float, float, float, float], points: Doubles) -> tuple[Doubles, float]:
    """Return the rotation toward the object, (3, 3), and its distance, with which points (n, 3) fill the box."""
    low, high = np.array(box[:2], np.float64), np.array(box[2:], np.float64)
    middle, size = np.array(view.middle), float(max(high - low)) or 1.0
    focal = np.array(view.focal or (1.0, 1.0))
    nearest = NEAREST - float(points[:, 2].min())
    distance = max(view.camera.distance, nearest)
    ray = np.zeros(2)  # toward the object: x and y at z = 1
    for _ in range(ROUNDS):
        rotation = _toward(ray)
        if view.focal is None:
            extent = _corners(rotation, points, distance)
            focal = np.full(2, size / max(*(extent[1] - extent[0]), SMALLEST))
        elif not view.camera.distance:
            distance = _distance(rotation, points, focal, size, nearest)
        extent = _corners(rotation, points, distance)
        ray = ray + ((low + high) / 2 - middle) / focal - extent.mean(axis=0)
    return _toward(ray), distance


def _distance(rotation: Doubles, points: Doubles, focal: Doubles, size: float, nearest: float) -> float:
    """Return the distance at which the projection of points is `size` pixels long."""
    low, high = nearest, DISTANCES[1]
    for _ in range(HALVINGS):
        distance = math.sqrt(low * high)
        extent = _corners(rotation, points, distance)
        if float(max((extent[1] - extent[0]) * focal)) > size:
            low = distance
        else:
            high = distance
    return high


def _corners(rotation: Doubles, points: Doubles, distance: float) -> Doubles:
    """Return the smallest and largest x and y of projected points at z = 1: (2, 2)."""
    placed = (points + np.array([0.0, 0.0, distance])) @ rotation.T
    projected = placed[:, :2] / np.maximum(placed[:, 2:], NEAREST)
    return np.stack([projected.min(axis=0), projected.max(axis=0)])


def _toward(ray: Doubles) -> Doubles:
    """Return the smallest rotation, (3, 3), that turns the z axis to the direction (x, y, 1)."""
    x, y, z = (float(part) / math.hypot(*ray, 1.0) for part in (*ray, 1.0))
    return np.array(
        [
            [1 - x * x / (1 + z), -x * y / (1 + z), x],
            [-x * y / (1 + z), 1 - y * y / (1 + z), y],
            [-x, -y, z],
        ]
    )


def _facing(camera: Camera) -> Doubles:
    """Return the rotation from the object frame to that of a camera which looks at the center: right, down, forward."""
    toward, right, up = (axis.astype(np.float64) for axis in camera_axes(camera.azimuth, camera.elevation))
    roll = math.radians(camera.roll)
    right, up = math.cos(roll) * right - math.sin(roll) * up, math.cos(roll) * up + math.sin(roll) * right
    return np.stack([right, -up, -toward])


def _pose(rotation: Doubles, position: Doubles) -> Pose:
    right, down, forward, center = ((float(x), float(y), float(z)) for x, y, z in (*rotation, position))
    return Pose((right, down, forward), center)


def _first(value: float | None, default: float) -> float:
    return default if value is None else value
