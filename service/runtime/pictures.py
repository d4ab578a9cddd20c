"""Draw a stored object as a picture or a turntable, and what that costs."""

from typing import Final

import numpy as np
import numpy.typing as npt

from service.drawing.cloud import AZIMUTH_DEG, ELEVATION_DEG
from service.drawing.surface import draw_surface
from service.errors import InvalidParameter
from service.mapping.frame import Frame
from service.mapping.spec import Functions, MappingSpec
from service.mapping.surface import Surface
from service.runtime.cost import cost_of_object
from service.runtime.options import TURNTABLE_SIZE, MeshOptions, PictureOptions, PictureView
from service.runtime.shapes import functions_for, mesh_of
from service.storage.rows import Record

RESOLUTION: Final = 56  # of the surface; more is hardly seen at the largest size
TRIANGLES: Final = 20 * RESOLUTION**2
CAMERAS: Final[dict[PictureView, tuple[float, float]]] = {  # azimuth and elevation, degrees
    "three-quarter": (AZIMUTH_DEG, ELEVATION_DEG),
    "front": (0, 0),
    "side": (90, 0),
    "back": (180, 0),
    "top": (0, 90),
}
FRAGMENTS: Final = 24  # for each pixel of the picture: those of all triangles, supersampled; 4 to 64
KEPT_PIXELS: Final = 4  # pixels of a finished picture that take as much memory as a point
TURN_MS: Final = 3600  # of a turntable


def picture_cost(record: Record, options: PictureOptions) -> int:
    """Return the cost of a picture, in points of the default model; a fragment takes about as long as a point.

    The pictures of a turntable are drawn one after another, so one is in work at a time, and the others wait in memory.
    """
    cost = cost_of_object(record, in_color=options.color == "auto")
    return TRIANGLES * cost + (FRAGMENTS + (options.frames - 1) // KEPT_PIXELS) * options.size**2


def check_turntable(options: PictureOptions) -> None:
    """Raise InvalidParameter if a turntable is too large."""
    if options.frames > 1 and options.size > TURNTABLE_SIZE:
        detail = f"size is {options.size}, the limit for {options.frames} frames is {TURNTABLE_SIZE}"
        raise InvalidParameter(detail, field="size")


def scene_of(spec: MappingSpec, functions: Functions, frame: Frame, options: PictureOptions) -> Surface:
    """Compute the surface of an object's pictures. Raises CorruptWeights."""
    return mesh_of(spec, functions_for(functions, options.color), frame, MeshOptions(resolution=RESOLUTION))


def draw_frame(scene: Surface, options: PictureOptions, index: int) -> npt.NDArray[np.uint8]:
    """Draw one of `options.frames` pictures of a surface, (size, size, 3) uint8, RGB; 0 is the view's own."""
    azimuth, elevation = CAMERAS[options.view]
    turned = azimuth + 360 * index / options.frames
    return draw_surface(scene, options.size, turned, elevation)
