"""JSON of every answer, and the parts of its OpenAPI description that several routes share."""

import base64
from dataclasses import asdict
from datetime import datetime
from functools import lru_cache
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import BaseModel, Field, computed_field
from pydantic.json_schema import SkipJsonSchema

from service.encoding.encoder import Encoded
from service.encoding.estimates import Estimates
from service.encoding.framing import Framed
from service.encoding.masks import Mask
from service.encoding.report import ImageReport as Report
from service.mapping.frame import Frame
from service.mapping.spec import CACHED_SPECS, Activation, Array, Domain, Functions, MappingSpec
from service.storage.rows import Kind, Record

Responses = dict[int | str, dict[str, Any]]  # of a route, by status, as FastAPI takes them


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


class Links(BaseModel):
    """Paths of the object and of its files, relative to the service."""

    self_: str = Field(alias="self", examples=["/objects/2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b"])
    points: str = Field(examples=["/objects/2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b/points"])
    mesh: str = Field(examples=["/objects/2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b/mesh"])
    weights: str = Field(examples=["/objects/2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b/weights"])


ColorSpec = Annotated[
    Spec | SkipJsonSchema[None],
    Field(
        default=None,
        exclude_if=lambda value: value is None,
        description="of an object in color: the shape of the function from canonical points to red, green, blue",
    ),
]


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
        return cls(**asdict(report))


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
        "object, estimated by the model. Not the mask's confidence, which is `image.confidence`. Absent unless the "
        "object was encoded by a model that estimates it",
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


class StoredObject(BaseModel):
    """An object: a mapping function that the service keeps."""

    id: str = Field(examples=["2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b"])
    kind: Kind = Field(
        description="`encoded` from an image, `imported` from a weights file, `composed` or `interpolated` from others"
    )
    created_at: datetime = Field(description="RFC 3339, UTC")
    model: str = Field(description="the model that theta comes from", examples=["hof1-k2"])
    spec: Spec
    color: ColorSpec = None
    word: list[str] | SkipJsonSchema[None] = Field(
        default=None,
        exclude_if=lambda value: value is None,
        description="of a composed object: the ids of its k functions, the last one applied first",
    )
    parents: list[str] | SkipJsonSchema[None] = Field(
        default=None,
        exclude_if=lambda value: value is None,
        description="of an interpolated object: the ids of the objects whose thetas it averages, even if deleted since",
    )
    bytes: int = Field(
        description="size of theta, 4 bytes for each number; of a composed object, of its k thetas",
        examples=[28684],
    )
    dimensions: Dimensions | SkipJsonSchema[None] = Field(
        default=None, exclude_if=lambda value: value is None, description=DIMENSIONS + UNMEASURED
    )
    frame: Box | SkipJsonSchema[None] = Field(
        default=None, exclude_if=lambda value: value is None, description=BOX + UNMEASURED
    )
    image: ImageReport | SkipJsonSchema[None] = Field(
        default=None,
        exclude_if=lambda value: value is None,
        description="of an encoded object: its photo, unless an older version of the service stored it",
    )
    shape_confidence: ShapeConfidence = None
    camera: PhotoCamera = None
    links: Links

    @classmethod
    def of(cls, record: Record, root_path: str | None) -> "StoredObject":
        """Return the JSON form of a record; its links begin with `root_path`, as a proxy offers them."""
        return cls(**_object_fields(record, root_path))


class ComposedObjects(BaseModel):
    """The objects that `all` makes, in order."""

    objects: list[StoredObject]


Weights64 = Annotated[str, Field(description="theta: base64 of its float32 numbers, little-endian")]
ColorWeights64 = Annotated[
    str | SkipJsonSchema[None],
    Field(default=None, description="the color's weights, if the object has color: encoded like those of theta"),
]


class EncodedObject(StoredObject):
    """An object, the report on its image, and its weights if `include=weights`."""

    image: ImageReport
    weights: Weights64 | SkipJsonSchema[None] = None
    color_weights: ColorWeights64 = None

    @classmethod
    def of_image(
        cls, record: Record, framed: Framed, functions: Functions | None, root_path: str | None = None
    ) -> "EncodedObject":
        """Return the JSON form of a record, for the client that sent its image."""
        weights = _weights_fields(functions) if functions else {}
        fields = _object_fields(record, root_path) | {"image": ImageReport.of(Report.of(framed))}
        return cls(**fields, **weights)


class EncodedWeights(BaseModel):
    """The answer to `store=false`: theta itself; nothing is kept."""

    model: str = Field(examples=["hof1-k2"])
    spec: Spec
    color: ColorSpec = None
    bytes: int = Field(examples=[28684])
    dimensions: Dimensions
    frame: Box
    image: ImageReport
    shape_confidence: ShapeConfidence = None
    camera: PhotoCamera = None
    weights: Weights64
    color_weights: ColorWeights64 = None

    @classmethod
    def of(cls, model: str, spec: MappingSpec, functions: Encoded, frame: Frame, framed: Framed) -> "EncodedWeights":
        """Return the JSON form of functions that are not kept."""
        return cls(
            model=model,
            spec=Spec.of(spec),
            color=Spec.of(functions.color.spec) if functions.color else None,
            bytes=functions.theta.nbytes,
            dimensions=frame.dimensions,
            frame=Box(**asdict(frame)),
            image=ImageReport.of(Report.of(framed)),
            **_estimates_fields(functions.estimates.rounded() if functions.estimates else None),
            **_weights_fields(functions),
        )


class ObjectPage(BaseModel):
    """A page of the list of objects, newest first."""

    items: list[StoredObject]
    next: str | None = Field(description="cursor of the next page; null on the last")
    limit: int


class Health(BaseModel):
    """The answer to a probe."""

    status: Literal["live", "ready"]


class FieldError(BaseModel):
    """An error in one parameter."""

    field: str = Field(examples=["n"])
    message: str = Field(examples=["Input should be less than or equal to 10000000"])


class Problem(BaseModel):
    """An error, after RFC 9457."""

    type: str = Field(examples=["urn:hof:problem:invalid-parameter"])
    title: str = Field(examples=["Invalid parameter"])
    status: int = Field(examples=[422])
    detail: str = Field(examples=["n: Input should be less than or equal to 10000000"])
    errors: list[FieldError] | SkipJsonSchema[None] = Field(
        default=None, description="one entry for each faulty parameter"
    )

    @computed_field(description="`detail` again, where clients of the Open Inference Protocol look for it")
    def error(self) -> str:  # noqa: D102
        return self.detail


BINARY: Final = {"schema": {"type": "string", "format": "binary"}}
RETRY_AFTER: Final = {"Retry-After": {"description": "seconds to wait before a retry", "schema": {"type": "integer"}}}
OBJECT_LOCATION: Final = {"Location": {"description": "path of the object", "schema": {"type": "string"}}}
OBJECT_NOT_FOUND: Final[Responses] = {404: {"model": Problem, "description": "No object of that id"}}
BODY_STALLED: Final[dict[str, Any]] = {"model": Problem, "description": "The body arrives too slowly"}
NO_SPACE: Final[dict[str, Any]] = {
    "model": Problem,
    "description": "The store has no space left; the object is not kept",
}
OVERLOADED: Final[dict[str, Any]] = {
    "model": Problem,
    "description": "The service works at its limit, or the client has used up its rate limit",
    "headers": RETRY_AFTER,
}


def _object_fields(record: Record, root_path: str | None) -> dict[str, Any]:
    path = f"{root_path or ''}/objects/{record.id}"
    composed = record.kind == "composed"
    return {
        "id": record.id,
        "kind": record.kind,
        "created_at": record.created_at,
        "model": record.model,
        "spec": Spec.of(record.spec),
        "color": Spec.of(record.color_spec) if record.color_spec else None,
        "word": list(record.members) if composed else None,
        "parents": list(record.members) if record.kind == "interpolated" else None,
        "bytes": 4 * record.spec.size * (record.spec.k if composed else 1),
        "dimensions": record.frame.dimensions if record.frame else None,
        "frame": Box(**asdict(record.frame)) if record.frame else None,
        "image": ImageReport.of(record.image) if record.image else None,
        **_estimates_fields(record.estimates),
        "links": Links(self=path, points=f"{path}/points", mesh=f"{path}/mesh", weights=f"{path}/weights"),
    }


def _estimates_fields(estimates: Estimates | None) -> dict[str, Any]:
    return asdict(estimates) if estimates else {}


def _weights_fields(functions: Functions) -> dict[str, Any]:
    """Return the numbers of functions as base64 of float32, little-endian."""
    arrays = {"weights": functions.theta} | ({"color_weights": functions.color.weights} if functions.color else {})
    return {name: _base64(array) for name, array in arrays.items()}


def _base64(array: Array) -> str:
    return base64.b64encode(np.ascontiguousarray(array, dtype="<f4").tobytes()).decode("ascii")
