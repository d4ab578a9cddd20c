"""Parts of the JSON of an object: spec, links, box, report on its photo, estimates."""

from dataclasses import asdict
from functools import lru_cache
from typing import Annotated, Final

from pydantic import BaseModel, Field
from pydantic.json_schema import SkipJsonSchema

from service.encoding.masks import Mask
from service.encoding.report import ImageReport as Report
from service.mapping.spec import CACHED_SPECS, Activation, Domain, MappingSpec


class Spec(BaseModel):
    """The shape of a function: the mapping function, whose weights are theta, or the color function of its points."""

    name: str = Field(examples=["HOF-1"])
    input_dim: int = Field(description="dimensions of the canonical domain", examples=[3])
    hidden: list[int] = Field(description="widths of the hidden layers, first to last", examples=[[1024]])
    output_dim: int = Field(examples=[3])
    activation: Activation
    k: int = Field(description="number of times f is applied: the object is f^k of the canonical points", examples=[2])
    domain: Domain = Field(description="canonical domain, sampled uniformly: radius 1, or [-1, 1]^3")

    @classmethod
    @lru_cache(CACHED_SPECS)
    def of(cls, spec: MappingSpec) -> "Spec":
        """Return the JSON form of a spec."""
        return cls(**asdict(spec))


ColorSpec = Annotated[
    Spec | SkipJsonSchema[None],
    Field(
        default=None,
        exclude_if=lambda value: value is None,
        description="of an object in color: the shape of the function from canonical points to red, green, blue",
    ),
]


class Links(BaseModel):
    """Paths of the object and of its files, relative to the service."""

    self_: str = Field(alias="self", examples=["/objects/2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b"])
    points: str = Field(examples=["/objects/2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b/points"])
    mesh: str = Field(examples=["/objects/2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b/mesh"])
    weights: str = Field(examples=["/objects/2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b/weights"])
    photo: str | SkipJsonSchema[None] = Field(
        default=None,
        exclude_if=lambda value: value is None,
        description="a small picture of the object in its photo; absent unless one is kept",
        examples=["/objects/2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b/photo"],
    )


class Box(BaseModel):
    """The bounding box of the object in its function's own numbers, as `frame=raw` gives them.

    The object frame is (raw - (low + high) / 2) / max(high - low).
    """

    low: tuple[float, float, float] = Field(examples=[[-0.31, -0.52, -0.33]])
    high: tuple[float, float, float] = Field(examples=[[0.34, 0.52, 0.38]])


DIMENSIONS: Final = (
    "width, height and depth of the whole object in the object frame: the longest is 1; multiply by `scale`"
)
BOX: Final = "the object's bounding box in the function's own numbers"
UNMEASURED: Final = ". Absent in lists for objects that an older version of the service stored, until they are read"
Dimensions = Annotated[
    tuple[float, float, float],
    Field(
        description=DIMENSIONS,
        examples=[[0.62, 1.0, 0.68]],
    ),
]


class ImageReport(BaseModel):
    """Report on the separation of the object from its background."""

    mask: Mask = Field(
        description="method that removed the background: transparency, a uniform border, matting or none"
    )
    box: tuple[int, int, int, int] = Field(
        description="left, top, right, bottom of the object, pixels of the upright image", examples=[[40, 12, 480, 502]]
    )
    confidence: Annotated[float, Field(ge=0, le=1)] | SkipJsonSchema[None] = Field(
        default=None,
        exclude_if=lambda value: value is None,
        description="confidence of the mask: its mean, weighted by itself; 1 if every pixel is either object or "
        "background. Absent if the mask is `none`",
    )
    width: int = Field(description="of the upright image, pixels")
    height: int = Field(description="of the upright image, pixels")

    @classmethod
    def of(cls, report: Report) -> "ImageReport":
        """Return the JSON form of a report."""
        return cls(**vars(report))  # not asdict, which copies each value: a tenth of a repeated photo's time


class Camera(BaseModel):
    """The camera that took the photo, as the model sees it. It looks at the object's center, in the object frame."""

    azimuth: float = Field(
        ge=-180,
        le=180,
        description="degrees from the front (+Z) toward +X: 0 sees the front, 90 the side at +X, 180 the back",
        examples=[31.5],
    )
    elevation: float = Field(description="degrees above the object's horizontal plane", examples=[18.2])
    distance: float = Field(description="from the object's center, in its longest sides", examples=[2.9])
    roll: float = Field(
        description="degrees that the camera is turned clockwise; the object in the photo is turned the other way",
        examples=[0.4],
    )


ShapeConfidence = Annotated[
    Annotated[float, Field(ge=0, le=1)] | SkipJsonSchema[None],
    Field(
        default=None,
        exclude_if=lambda value: value is None,
        description="how well the shape is expected to fit: the F-score at 2% of the longest side against the true "
        "object, estimated by the model; about 0.1 too high where a network masks the photo. Not the mask's "
        "confidence, which is `image.confidence`. Absent unless the object was encoded by a model that estimates it",
        examples=[0.57],
    ),
]
PhotoCamera = Annotated[
    Camera | SkipJsonSchema[None],
    Field(
        default=None,
        exclude_if=lambda value: value is None,
        description="the camera that took the photo, as the model sees it. Absent unless the object was encoded by a "
        "model that estimates it",
    ),
]
