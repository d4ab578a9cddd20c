"""What goes over the wire: query parameters in, JSON out. The schema and its limits come from here."""

import base64
from dataclasses import asdict
from datetime import datetime
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from pydantic.json_schema import SkipJsonSchema

from service.canonical import Sampling
from service.composition import Mode
from service.formats.weights import WeightFormatName
from service.images import Background, Framed, Mask
from service.mapping import MAX_K, Activation, Array, Domain, MappingSpec, word_of
from service.points import Cloud
from service.sampler import SCALES
from service.settings import POINTS_CEILING
from service.store import Kind, Record

PointFormatName = Literal["ply", "npy", "xyz", "json", "glb", "gltf", "pcd", "f32", "f16"]

MAX_SEED = 2**63 - 1


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
    model: str | None = Field(default=None, max_length=200, description="name of a loaded model")


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
    scale: float = Field(
        default=1.0,
        ge=SCALES[0],
        le=SCALES[1],
        description="length of the longest side, in metres say; the object's own is 1",
    )
    sampling: Sampling = Field(
        default="uniform",
        description="`uniform` draws independent points; `sobol` covers the object more evenly, for offset + n up to "
        "2^32",
    )
    format: PointFormatName | None = Field(
        default=None, description="file format; wins over `Accept`; PLY where neither says"
    )

    def cloud(self, spec: MappingSpec, theta: Array) -> Cloud:
        """The points that are asked for of an object, theta (size,) or (k, size). Raises InvalidParameter."""
        return Cloud(spec, word_of(spec, theta), self.n, self.seed, self.offset, self.scale, self.sampling)


class WeightsQuery(NoQuery):
    """How theta is written."""

    format: WeightFormatName = Field(
        default="safetensors",
        description="file format; `safetensors` carries the spec and can be posted to `/objects`; `onnx` is the whole "
        "function, k included: x (n, input_dim) -> points (n, 3), float32",
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


class Spec(BaseModel):
    """The shape of the mapping function whose weights are theta."""

    name: str = Field(examples=["HOF-1"])
    input_dim: int = Field(description="dimensions of the canonical domain", examples=[3])
    hidden: list[int] = Field(description="widths of the hidden layers, first to last", examples=[[1024]])
    output_dim: int = Field(examples=[3])
    activation: Activation
    k: int = Field(description="how often f is applied: the object is f^k of the canonical points", examples=[2])
    domain: Domain = Field(description="canonical set, sampled uniformly; radius 1, or [-1, 1]^3")

    @classmethod
    def of(cls, spec: MappingSpec) -> "Spec":
        """The spec as it is shown."""
        return cls(**asdict(spec))


class Links(BaseModel):
    """Where the object and what it gives are, relative to the service."""

    self_: str = Field(alias="self", examples=["/objects/2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b"])
    points: str = Field(examples=["/objects/2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b/points"])
    weights: str = Field(examples=["/objects/2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b/weights"])


class StoredObject(BaseModel):
    """An object: a mapping function that the service keeps."""

    id: str = Field(examples=["2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b"])
    kind: Kind = Field(
        description="`encoded` from an image, `imported` from a weights file, `composed` or `interpolated` from others"
    )
    created_at: datetime = Field(description="RFC 3339, UTC")
    model: str = Field(description="the model that theta comes from", examples=["hof1-k2"])
    spec: Spec
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


class EncodedObject(StoredObject):
    """An object, how its image was understood, and its weights where asked for."""

    image: ImageReport
    weights: Weights64 | SkipJsonSchema[None] = None

    @classmethod
    def of_image(cls, record: Record, framed: Framed, theta: Array | None) -> "EncodedObject":
        """The record as it is shown to who sent the image."""
        weights = None if theta is None else base64_of(theta)
        return cls(**_object_fields(record), image=ImageReport.of(framed), weights=weights)


class EncodedWeights(BaseModel):
    """The answer where nothing is kept: theta itself."""

    model: str = Field(examples=["hof1-k2"])
    spec: Spec
    bytes: int = Field(examples=[28684])
    image: ImageReport
    weights: Weights64


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
    """The loaded model."""

    name: str = Field(examples=["hof1-k2"])
    digest: str = Field(description="sha256 of the model file, hexadecimal")
    spec: Spec
    framing: ModelFraming
    card: dict[str, Any] = Field(description="the model card as the file carries it: data, licence, figures, limits")


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


def base64_of(theta: Array) -> str:
    """theta as base64 of float32, little-endian."""
    return base64.b64encode(np.ascontiguousarray(theta, dtype="<f4").tobytes()).decode("ascii")


def _object_fields(record: Record) -> dict[str, Any]:
    path = f"/objects/{record.id}"
    composed = record.kind == "composed"
    return {
        "id": record.id,
        "kind": record.kind,
        "created_at": record.created_at,
        "model": record.model,
        "spec": Spec.of(record.spec),
        "word": list(record.members) if composed else None,
        "parents": list(record.members) if record.kind == "interpolated" else None,
        "bytes": 4 * record.spec.size * (record.spec.k if composed else 1),
        "links": Links(self=path, points=f"{path}/points", weights=f"{path}/weights"),
    }
