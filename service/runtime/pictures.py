"""Draw a stored object as a picture, and what that costs."""

from typing import Final

import numpy as np
import numpy.typing as npt

from service.drawing.cloud import AZIMUTH_DEG, ELEVATION_DEG, draw
from service.mapping.frame import Frame
from service.mapping.spec import Functions, MappingSpec
from service.runtime.cost import cost_of_object
from service.runtime.options import PictureOptions, PictureView, PointOptions
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


def picture_cost(record: Record, options: PictureOptions) -> int:
    """Return the cost of a picture, in points of the default model; a disc's pixel takes about as long as a point."""
    return PICTURE_POINTS * cost_of_object(record, in_color=options.color == "auto") + DISC_PIXELS * options.size**2


def picture_of(spec: MappingSpec, functions: Functions, frame: Frame, options: PictureOptions) -> npt.NDArray[np.uint8]:
    """Draw an object over white, (size, size, 3) uint8, RGB. Raises CorruptWeights."""
    cloud = cloud_of(spec, functions, frame, PointOptions(n=PICTURE_POINTS, color=options.color))
    whole = 0, PICTURE_POINTS
    colors = cloud.colors(whole) if cloud.functions.color else None
    return draw(cloud.points(whole), options.size, *CAMERAS[options.view], colors)
