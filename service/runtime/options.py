"""Options of encoding, sampling, meshing and drawing: limits and defaults, for the API and the offline commands."""

from typing import Annotated, Final, Literal

from pydantic import BaseModel, Field

from service.encoding.framing import Background
from service.mapping.canonical import Sampling
from service.mapping.sampler import SCALES
from service.mapping.surface import RESOLUTION, RESOLUTIONS
from service.planning.path import CELLS
from service.settings import POINTS_CEILING

ColorChoice = Literal["auto", "none"]
FrameChoice = Literal["object", "raw"]
ShapeFrame = Literal["object", "raw", "camera"]
PictureView = Literal["three-quarter", "front", "side", "back", "top"]

MAX_SEED: Final = 2**63 - 1
FRAMES: Final = (1, 36)
TURNTABLE_SIZE: Final = 320  # largest side of a picture that turns, pixels
DISTANCES: Final = (0.9, 1000.0)  # longest sides: from just outside any object

Scale = Annotated[
    float,
    Field(
        ge=SCALES[0],
        le=SCALES[1],
        description="length of the longest side of the object's box, for example in meters; with `frame=raw`, a factor",
        examples=[0.8],
    ),
]
ChosenFrame = Annotated[
    FrameChoice,
    Field(
        description="`object` centers the box of the whole object at the origin and makes its longest side `scale` "
        "long; `raw` gives the function's own numbers times `scale`",
    ),
]
ChosenShapeFrame = Annotated[
    ShapeFrame,
    Field(
        description="`object` centers the box of the whole object at the origin and makes its longest side `scale` "
        "long; `raw` gives the function's own numbers times `scale`; `camera` is that of the camera that took the "
        "photo (x right, y down, z forward, as in OpenCV), in the unit of `scale`: it needs an object with a `camera`, "
        "or the parameters of one",
    ),
]
Coordinate = Annotated[float, Field(allow_inf_nan=False)]
Point = tuple[Coordinate, Coordinate, Coordinate]


class CameraOptions(BaseModel):
    """The camera of `frame=camera`. What is not given is that of the object, if it has a camera."""

    azimuth: float | None = Field(
        default=None,
        ge=-360,
        le=360,
        description="for `frame=camera`: degrees of the camera from the front (+Z) toward +X; by default the object's "
        "own `camera`, as for the next three",
    )
    elevation: float | None = Field(
        default=None, ge=-90, le=90, description="for `frame=camera`: degrees above the object's horizontal plane"
    )
    distance: float | None = Field(
        default=None,
        ge=DISTANCES[0],
        le=DISTANCES[1],
        description="for `frame=camera`: from the object's center, in its longest sides; by default, with `fx`, as the "
        "object's size in the photo tells",
    )
    roll: float | None = Field(
        default=None, ge=-360, le=360, description="for `frame=camera`: degrees that the camera is turned clockwise"
    )
    fx: float | None = Field(
        default=None,
        gt=0,
        le=1e6,
        description="for `frame=camera`: focal length in pixels of the upright photo; by default that with which the "
        "object, at the distance of the camera, fills its box in the photo",
    )
    fy: float | None = Field(default=None, gt=0, le=1e6, description="the same, down; by default `fx`")
    cx: float | None = Field(
        default=None,
        ge=-1e6,
        le=1e6,
        description="for `frame=camera`, with `fx`: the pixel at which the camera looks, from the photo's left; by "
        "default its middle",
    )
    cy: float | None = Field(default=None, ge=-1e6, le=1e6, description="the same, from the top; by default the middle")


class EncodeOptions(BaseModel):
    """Framing of an image before it is encoded."""

    background: Background = Field(
        default="auto",
        description="`auto` removes the background by the first method that applies: transparency, a uniform border, "
        "matting unless the service runs without it; if none does, it keeps the image as it is. `keep` always keeps "
        "the image as it is. `remove` answers 422 if no method applies. Of what matting removes, the encoder sees a "
        "trace",
    )
    foreground_ratio: float | None = Field(
        default=None,
        ge=0.1,
        le=1,
        description="share of the encoder's input that the object's longer side fills; by default as in the model's "
        "training, 0.85 for the shipped model. Where a network makes the mask, the input shows no more than the "
        "photo's longer side, so the share may be larger",
    )


class PointOptions(CameraOptions):
    """The points of an object to compute."""

    n: int = Field(default=10_000, ge=1, le=POINTS_CEILING, description="number of points; JSON holds at most 100,000")
    seed: int = Field(default=0, ge=0, le=MAX_SEED, description="seed of the canonical points")
    offset: int = Field(
        default=0,
        ge=0,
        le=2**53,
        description="points to skip: n=10&offset=90 gives the last ten of n=100 of the same seed",
    )
    scale: Scale = 1.0
    frame: ChosenShapeFrame = "object"
    sampling: Sampling = Field(
        default="uniform",
        description="`uniform` draws independent points; `sobol` covers the object more evenly, for offset + n up to "
        "2^32",
    )
    color: ColorChoice = Field(
        default="auto",
        description="`auto` writes colors if the object has them and the format holds them: `ply`, `json`, `glb`, "
        "`gltf`, `pcd`; `none` leaves them out",
    )


class MeshOptions(CameraOptions):
    """Resolution, scale and colors of an object's surface."""

    resolution: int = Field(
        default=RESOLUTION,
        ge=RESOLUTIONS[0],
        le=RESOLUTIONS[1],
        description="makes 20 resolution^2 triangles; those that the function tears apart are left out",
    )
    scale: Scale = 1.0
    frame: ChosenShapeFrame = "object"
    color: ColorChoice = Field(
        default="auto",
        description="`auto` writes the vertices' colors if the object has them and the format holds them: `glb`, "
        "`gltf`, `obj`, `ply`, `usdz`; `none` leaves them out",
    )


class PictureOptions(BaseModel):
    """Size, view and colors of a picture."""

    size: int = Field(default=320, ge=32, le=512, description="side of the picture, pixels")
    view: PictureView = Field(
        default="three-quarter",
        description="direction of the camera: `three-quarter` is from the front, 30 degrees to the right and 22 above",
    )
    frames: int = Field(
        default=1,
        ge=FRAMES[0],
        le=FRAMES[1],
        description="1 is a still picture; with more, the object turns once around, in as many pictures, which "
        f"`webp` and `gif` hold; `size` is then at most {TURNTABLE_SIZE}",
    )
    color: ColorChoice = Field(
        default="auto", description="`auto` draws colors if the object has them; `none` draws shades of blue"
    )


class PathOptions(BaseModel):
    """A path around an object: its ends, and how coarse and how careful it is."""

    start: Point = Field(
        description="x, y, z where the path begins, in the object's frame and scale, no farther from the middle than "
        "`scale` along each axis",
        examples=[[-0.9, 0.1, 0.2]],
    )
    goal: Point = Field(description="x, y, z where it ends, likewise", examples=[[0.9, 0.1, -0.2]])
    cells: int = Field(
        default=32,
        ge=CELLS[0],
        le=CELLS[1],
        description="cells along each side of the cube in which the path is planned; the cube is twice as long as the "
        "object's longest side",
    )
    clearance: float = Field(
        default=0,
        ge=0,
        le=SCALES[1],
        allow_inf_nan=False,
        description="smallest distance of the path from the object's points, in the unit of `scale`: for a robot, the "
        "radius of a ball around it",
    )
    scale: Scale = 1.0
    frame: ChosenFrame = "object"
