"""Draw a stored object as a picture or a turntable, and what that costs."""

from dataclasses import dataclass
from typing import Final

import numpy as np
import numpy.typing as npt

from service.drawing.cloud import AZIMUTH_DEG, ELEVATION_DEG, draw
from service.errors import InvalidParameter
from service.mapping.frame import Frame
from service.mapping.spec import Array, Colors, Functions, MappingSpec
from service.runtime.cost import cost_of_object
from service.runtime.options import TURNTABLE_SIZE, PictureOptions, PictureView, PointOptions
from service.runtime.shapes import cloud_of
from service.storage.rows import Record

PICTURE_POINTS: Final = 40_000  # more cannot be told apart at the largest size
CAMERAS: Final[dict[PictureView, tuple[float, float]]] = {  # azimuth and elevation, degrees
    "three-quarter": (AZIMUTH_DEG, ELEVATION_DEG),
    "front": (0, 0),
    "side": (90, 0),
    "back": (180, 0),
    "top": (0, 90),
}
DISC_PIXELS: Final = 8  # for each pixel of the picture: the discs of all points, supersampled (service.drawing.cloud)
KEPT_PIXELS: Final = 4  # pixels of a finished picture that take as much memory as a point
TURN_MS: Final = 3600  # of a turntable


@dataclass(frozen=True, eq=False)
class Scene:
    """The points of a picture, (n, 3) float32, and their colors, (n, 3) uint8, if it has colors."""

    points: Array
    colors: Colors | None


def picture_cost(record: Record, options: PictureOptions) -> int:
    """Return the cost of a picture, in points of the default model; a disc's pixel takes about as long as a point.

    The pictures of a turntable are drawn one after another, so one is in work at a time, and the others wait in memory.
    """
    cost = cost_of_object(record, in_color=options.color == "auto")
    return PICTURE_POINTS * cost + (DISC_PIXELS + (options.frames - 1) // KEPT_PIXELS) * options.size**2


def check_turntable(options: PictureOptions) -> None:
    """Raise InvalidParameter if a turntable is too large."""
    if options.frames > 1 and options.size > TURNTABLE_SIZE:
        detail = f"size is {options.size}, the limit for {options.frames} frames is {TURNTABLE_SIZE}"
        raise InvalidParameter(detail, field="size")


def scene_of(spec: MappingSpec, functions: Functions, frame: Frame, options: PictureOptions) -> Scene:
    """Compute the points of an object's pictures. Raises CorruptWeights."""
    cloud = cloud_of(spec, functions, frame, PointOptions(n=PICTURE_POINTS, color=options.color))
    whole = 0, PICTURE_POINTS
    return Scene(cloud.points(whole), cloud.colors(whole) if cloud.functions.color else None)


def draw_frame(scene: Scene, options: PictureOptions, index: int) -> npt.NDArray[np.uint8]:
    """Draw one of `options.frames` pictures of a scene over white, (size, size, 3) uint8, RGB; 0 is the view's own."""
    azimuth, elevation = CAMERAS[options.view]
    turned = azimuth + 360 * index / options.frames
    return draw(scene.points, options.size, turned, elevation, scene.colors)
