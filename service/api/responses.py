"""What goes out over the wire: the JSON of every answer."""

import base64
from dataclasses import asdict
from datetime import datetime
from functools import lru_cache
from typing import Annotated, Any, Final, Literal

import numpy as np
from pydantic import BaseModel, Field, computed_field
from pydantic.json_schema import SkipJsonSchema

from service.encoding.encoder import Encoder
from service.encoding.framing import Framed, Mask
from service.mapping.spec import CACHED_SPECS, Activation, Array, Domain, Functions, MappingSpec
from service.storage.store import Kind, Record


class Spec(BaseModel):
    """The shape of a function: the mapping function, whose weights are theta, or what colours its points."""

    name: str = Field(examples=["HOF-1"])
    input_dim: int = Field(description="dimensions of the canonical domain", examples=[3])
    hidden: list[int] = Field(description="widths of the hidden layers, first to last", examples=[[1024]])
    output_dim: int = Field(examples=[3])
    activation: Activation
    k: int = Field(description="how often f is applied: the object is f^k of the canonical points", examples=[2])
    domain: Domain = Field(description="canonical set, sampled uniformly; radius 1, or [-1, 1]^3")

    @classmethod
    @lru_cache(CACHED_SPECS)
    def of(cls, spec: MappingSpec) -> "Spec":
        """The spec as it is shown."""
        return cls(**asdict(spec))


class Links(BaseModel):
    """Where the object and what it gives are, relative to the service."""

    self_: str = Field(alias="self", examples=["/objects/2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b"])
    points: str = Field(examples=["/objects/2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b/points"])
    mesh: str = Field(examples=["/objects/2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b/mesh"])
    weights: str = Field(examples=["/objects/2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b/weights"])


ColorSpec = Annotated[
    Spec | SkipJsonSchema[None],
    Field(
        default=None,
        exclude_if=lambda value: value is None,
        description="of an object in colour: the shape of the function from canonical points to red, green, blue",
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
        description="of an interpolated object: the ids of those whose thetas it averages; they may be deleted since",
    )
    bytes: int = Field(
        description="size of theta, 4 bytes a number; of a composed object of its k thetas", examples=[28684]
    )
    links: Links

    @classmethod
    def of(cls, record: Record) -> "StoredObject":
        """The record as it is shown."""
        return cls(**_object_fields(record))


class ComposedObjects(BaseModel):
    """The objects that `all` makes, in order."""

    objects: list[StoredObject]


class ImageReport(BaseModel):
    """How the image was understood."""

    mask: Mask = Field(
        description="what told the object from its background: transparency, a uniform border, matting or nothing"
    )
    box: tuple[int, int, int, int] = Field(
        description="left, top, right, bottom of the object, pixels of the upright image", examples=[[40, 12, 480, 502]]
    )
    confidence: Annotated[float, Field(ge=0, le=1)] | SkipJsonSchema[None] = Field(
        default=None,
        description="of the mask: its mean, weighted by itself; 1 where every pixel is either object or background. "
        "Absent where the mask is `none`",
    )
    width: int = Field(description="of the upright image, pixels")
    height: int = Field(description="of the upright image, pixels")

    @classmethod
    def of(cls, framed: Framed) -> "ImageReport":
        """The report of a framed image."""
        confidence = None if framed.confidence is None else round(framed.confidence, 3)
        return cls(mask=framed.mask, box=framed.box, confidence=confidence, width=framed.width, height=framed.height)


Weights64 = Annotated[str, Field(description="theta: base64 of its float32 numbers, little-endian")]
ColorWeights64 = Annotated[
    str | SkipJsonSchema[None],
    Field(default=None, description="the colour's weights, where there is one: as those of theta"),
]


class EncodedObject(StoredObject):
    """An object, how its image was understood, and its weights where asked for."""

    image: ImageReport
    weights: Weights64 | SkipJsonSchema[None] = None
    color_weights: ColorWeights64 = None

    @classmethod
    def of_image(cls, record: Record, framed: Framed, functions: Functions | None) -> "EncodedObject":
        """The record as it is shown to who sent the image."""
        weights = _weights_fields(functions) if functions else {}
        return cls(**_object_fields(record), image=ImageReport.of(framed), **weights)


class EncodedWeights(BaseModel):
    """The answer where nothing is kept: theta itself."""

    model: str = Field(examples=["hof1-k2"])
    spec: Spec
    color: ColorSpec = None
    bytes: int = Field(examples=[28684])
    image: ImageReport
    weights: Weights64
    color_weights: ColorWeights64 = None

    @classmethod
    def of(cls, model: str, spec: MappingSpec, functions: Functions, framed: Framed) -> "EncodedWeights":
        """The functions as they are shown."""
        return cls(
            model=model,
            spec=Spec.of(spec),
            color=Spec.of(functions.color.spec) if functions.color else None,
            bytes=functions.theta.nbytes,
            image=ImageReport.of(framed),
            **_weights_fields(functions),
        )


class ObjectPage(BaseModel):
    """A part of the list of objects, newest first."""

    items: list[StoredObject]
    next: str | None = Field(description="cursor of the next page; null on the last")
    limit: int


class ModelFraming(BaseModel):
    """How the model wants its images."""

    size: int = Field(description="side of the encoder's input, pixels", examples=[64])
    foreground_ratio: float = Field(examples=[0.85])


class Model(BaseModel):
    """A loaded model."""

    name: str = Field(examples=["hof1-k2"])
    digest: str = Field(description="sha256 of the model file, hexadecimal")
    spec: Spec
    color: ColorSpec = None
    framing: ModelFraming
    card: dict[str, Any] = Field(description="the model card as the file carries it: data, licence, figures, limits")

    @classmethod
    def of(cls, encoder: Encoder) -> "Model":
        """The encoder as it is shown."""
        return cls(
            name=encoder.name,
            digest=encoder.digest,
            spec=Spec.of(encoder.spec),
            color=Spec.of(encoder.color_spec) if encoder.color_spec else None,
            framing=ModelFraming(**asdict(encoder.framing)),
            card=encoder.card,
        )


class ModelList(BaseModel):
    """The loaded models."""

    models: list[Model] = Field(description="the first is taken where a call names none")


class Health(BaseModel):
    """The answer of a probe."""

    status: Literal["live", "ready"]


class FieldError(BaseModel):
    """What is wrong with one parameter."""

    field: str = Field(examples=["n"])
    message: str = Field(examples=["Input should be less than or equal to 10000000"])


class Problem(BaseModel):
    """What went wrong, after RFC 9457."""

    type: str = Field(examples=["urn:hof:problem:invalid-parameter"])
    title: str = Field(examples=["Invalid parameter"])
    status: int = Field(examples=[422])
    detail: str = Field(examples=["n: Input should be less than or equal to 10000000"])
    errors: list[FieldError] | SkipJsonSchema[None] = Field(default=None, description="one entry a faulty parameter")

    @computed_field(description="`detail` once more, where clients of the Open Inference Protocol look for it")
    def error(self) -> str:  # noqa: D102
        return self.detail


RETRY_AFTER: Final = {"Retry-After": {"description": "when to try again, seconds", "schema": {"type": "integer"}}}
OVERLOADED: Final[dict[str, Any]] = {
    "model": Problem,
    "description": "The service has as much work as it lets in",
    "headers": RETRY_AFTER,
}


def _object_fields(record: Record) -> dict[str, Any]:
    path = f"/objects/{record.id}"
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
        "links": Links(self=path, points=f"{path}/points", mesh=f"{path}/mesh", weights=f"{path}/weights"),
    }


def _weights_fields(functions: Functions) -> dict[str, Any]:
    """Numbers as base64 of float32, little-endian."""
    arrays = {"weights": functions.theta} | ({"color_weights": functions.color.weights} if functions.color else {})
    return {name: _base64(array) for name, array in arrays.items()}


def _base64(array: Array) -> str:
    return base64.b64encode(np.ascontiguousarray(array, dtype="<f4").tobytes()).decode("ascii")
