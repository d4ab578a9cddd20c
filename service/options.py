"""What comes in over the wire: the parameters of each call, and their limits."""

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from service.encoding.framing import Background
from service.formats.weights import WeightFormatName
from service.mapping.canonical import Sampling
from service.mapping.cloud import Cloud
from service.mapping.color import ColorSampler
from service.mapping.sampler import SCALES, Sampler
from service.mapping.spec import MAX_K, Functions, MappingSpec, word_of
from service.mapping.surface import RESOLUTION, RESOLUTIONS, Surface, surface_of
from service.runtime.composition import Mode
from service.settings import POINTS_CEILING

PointFormatName = Literal["ply", "npy", "xyz", "json", "glb", "gltf", "pcd", "f32", "f16"]
MeshFormatName = Literal["glb", "gltf", "obj", "stl", "ply"]

ColorChoice = Literal["auto", "none"]

MAX_SEED = 2**63 - 1

ModelName = Annotated[
    str | None, Field(max_length=200, description="name of a loaded model; by default the first that `/models` lists")
]
Scale = Annotated[
    float,
    Field(ge=SCALES[0], le=SCALES[1], description="length of the longest side, in metres say; the object's own is 1"),
]


class NoQuery(BaseModel):
    """The parameters of a call that takes none: any is an error."""

    model_config = ConfigDict(extra="forbid")


class EncodeQuery(NoQuery):
    """How an image is encoded, and what comes back."""

    store: bool = Field(default=True, description="keep the object; `false` returns its weights and keeps nothing")
    background: Background = Field(
        default="auto",
        description="`auto` removes the background: by transparency, else by a uniform border, else by matting where "
        "the service has a model for it, else not; `keep` takes the image as it is; `remove` insists: 422 where "
        "nothing tells the background",
    )
    foreground_ratio: float | None = Field(
        default=None,
        ge=0.1,
        le=1,
        description="share of the encoder's input that the object's longer side takes; by default as in the model's "
        "training, 0.85 for the shipped model",
    )
    include: Literal["weights"] | None = Field(default=None, description="add `weights` to the answer")
    model: ModelName = None


class ModelQuery(NoQuery):
    """Which of the loaded models."""

    model: ModelName = None


class PageQuery(NoQuery):
    """Which part of the list."""

    limit: int = Field(default=50, ge=1, le=500, description="most items of the page")
    cursor: str | None = Field(default=None, max_length=64, description="`next` of the page before")


class PointsQuery(NoQuery):
    """Which points of the object, and how they are written."""

    n: int = Field(default=10_000, ge=1, le=POINTS_CEILING, description="how many points; JSON holds at most 100,000")
    seed: int = Field(default=0, ge=0, le=MAX_SEED, description="seed of the canonical points")
    offset: int = Field(
        default=0,
        ge=0,
        le=2**53,
        description="points to skip: n=10&offset=90 are the last ten of n=100 of the same seed",
    )
    scale: Scale = 1.0
    sampling: Sampling = Field(
        default="uniform",
        description="`uniform` draws independent points; `sobol` covers the object more evenly, for offset + n up to "
        "2^32",
    )
    format: PointFormatName | None = Field(
        default=None, description="file format; wins over `Accept`; PLY where neither says"
    )
    color: ColorChoice = Field(
        default="auto",
        description="`auto` writes colours where the object has them and the format holds them: `ply`, `json`, `glb`, "
        "`gltf`, `pcd`; `none` leaves them out",
    )

    def cloud(self, spec: MappingSpec, functions: Functions) -> Cloud:
        """The points that are asked for of an object. Raises InvalidParameter."""
        shown = Functions(functions.theta) if self.color == "none" else functions
        return Cloud(spec, shown, self.n, self.seed, self.offset, self.scale, self.sampling)


class MeshQuery(NoQuery):
    """How fine the surface is, and how it is written."""

    resolution: int = Field(
        default=RESOLUTION,
        ge=RESOLUTIONS[0],
        le=RESOLUTIONS[1],
        description="20 resolution^2 triangles, of which those that the function tears apart are left out",
    )
    scale: Scale = 1.0
    format: MeshFormatName | None = Field(
        default=None, description="file format; wins over `Accept`; GLB where neither says"
    )
    color: ColorChoice = Field(
        default="auto",
        description="`auto` writes the vertices' colours where the object has them and the format holds them: `glb`, "
        "`gltf`, `obj`, `ply`; `none` leaves them out",
    )

    def shown(self, functions: Functions, *, holds_color: bool) -> Functions:
        """Those of an object's functions that are asked for, in a format that holds colours or does not."""
        return functions if self.color == "auto" and holds_color else Functions(functions.theta)

    def surface(self, spec: MappingSpec, shown: Functions) -> Surface:
        """The surface of what is `shown` of an object.

        Raises
        ------
        CorruptWeights : the functions' values exceed float32.
        """
        sampler = Sampler(spec, word_of(spec, shown.theta))
        return surface_of(sampler, self.resolution, self.scale, ColorSampler(shown.color) if shown.color else None)


class WeightsQuery(NoQuery):
    """How theta is written."""

    format: WeightFormatName = Field(
        default="safetensors",
        description="file format; `safetensors` carries the spec and can be posted to `/objects`; `onnx` is the whole "
        "function, k included: x (n, input_dim) -> points (n, 3), float32; `json` holds at most 1,000,000 numbers",
    )


class Composition(NoQuery):
    """What to make of which objects."""

    objects: list[str] = Field(
        min_length=1,
        max_length=MAX_K,
        description="ids of objects of one spec, none of them composed: k for `compose`, two or more for "
        "`interpolate`, two for `all`",
    )
    mode: Mode = Field(
        default="compose",
        description="`compose` makes the word: of A, B the function f_A(f_B(x)), the last one applied first. `all` "
        "makes the 2^k words over two objects, in lexicographic order: AA, AB, BA, BB. `interpolate` averages "
        "theta; an object named twice weighs twice",
    )
