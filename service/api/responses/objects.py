"""JSON of objects, alone and in lists."""

import base64
from collections.abc import Sequence
from datetime import datetime
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, Field
from pydantic.json_schema import SkipJsonSchema

from service.api.responses.parts import (
    BOX,
    DIMENSIONS,
    UNMEASURED,
    Box,
    ColorSpec,
    Dimensions,
    ImageReport,
    Links,
    PhotoCamera,
    ShapeConfidence,
    Spec,
)
from service.encoding.encoder import Encoded
from service.encoding.estimates import Estimates
from service.encoding.report import ImageReport as Report
from service.mapping.frame import Frame
from service.mapping.spec import Array, Functions, MappingSpec
from service.storage.rows import Kind, Record


class StoredObject(BaseModel):
    """An object: a mapping function that the service keeps."""

    id: str = Field(examples=["2f7f3b52a9a1c0de9b1d1c4d5e6f7a8b"])
    kind: Kind = Field(
        description="`encoded` from an image, `imported` from a weights file, `composed` or `interpolated` from others"
    )
    label: str | SkipJsonSchema[None] = Field(
        default=None,
        exclude_if=lambda value: value is None,
        description="the name that people gave it; absent without one",
        examples=["Desk chair"],
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
        image = ImageReport.of(record.image) if record.image else None
        return cls(**object_fields(record, root_path), image=image)


class ComposedObjects(BaseModel):
    """The objects that `all` makes, in order."""

    objects: list[StoredObject]


ImageReports = Annotated[
    list[ImageReport] | SkipJsonSchema[None],
    Field(
        default=None,
        exclude_if=lambda value: value is None,
        description="of several images of one object: the report on each, in their order; `image` is that on the first",
    ),
]
Weights64 = Annotated[str, Field(description="theta: base64 of its float32 numbers, little-endian")]
ColorWeights64 = Annotated[
    str | SkipJsonSchema[None],
    Field(default=None, description="the color's weights, if the object has color: encoded like those of theta"),
]


class EncodedObject(StoredObject):
    """An object, the report on its image, and its weights if `include=weights`."""

    image: ImageReport
    images: ImageReports = None
    weights: Weights64 | SkipJsonSchema[None] = None
    color_weights: ColorWeights64 = None

    @classmethod
    def of_image(
        cls, record: Record, reports: Sequence[Report], functions: Functions | None, root_path: str | None = None
    ) -> "EncodedObject":
        """Return the JSON form of a record, for the client that sent its images."""
        weights = weights_fields(functions) if functions else {}
        return cls(**object_fields(record, root_path), **_image_fields(reports), **weights)


class EncodedWeights(BaseModel):
    """The answer to `store=false`: theta itself; nothing is kept."""

    model: str = Field(examples=["hof1-k2"])
    spec: Spec
    color: ColorSpec = None
    bytes: int = Field(examples=[28684])
    dimensions: Dimensions
    frame: Box
    image: ImageReport
    images: ImageReports = None
    shape_confidence: ShapeConfidence = None
    camera: PhotoCamera = None
    weights: Weights64
    color_weights: ColorWeights64 = None

    @classmethod
    def of(
        cls, model: str, spec: MappingSpec, functions: Encoded, frame: Frame, reports: Sequence[Report]
    ) -> "EncodedWeights":
        """Return the JSON form of functions that are not kept."""
        return cls(
            model=model,
            spec=Spec.of(spec),
            color=Spec.of(functions.color.spec) if functions.color else None,
            bytes=functions.theta.nbytes,
            dimensions=frame.dimensions,
            frame=Box(**vars(frame)),
            **_image_fields(reports),
            **_estimates_fields(functions.estimates.rounded() if functions.estimates else None),
            **weights_fields(functions),
        )


class ObjectPage(BaseModel):
    """A page of the list of objects, newest first."""

    items: list[StoredObject]
    next: str | None = Field(description="cursor of the next page; null on the last")
    limit: int


def object_fields(record: Record, root_path: str | None) -> dict[str, Any]:
    """Return the members of `StoredObject` for a record, except for `image`."""
    path = f"{root_path or ''}/objects/{record.id}"
    composed = record.kind == "composed"
    return {
        "id": record.id,
        "kind": record.kind,
        "label": record.label,
        "created_at": record.created_at,
        "model": record.model,
        "spec": Spec.of(record.spec),
        "color": Spec.of(record.color_spec) if record.color_spec else None,
        "word": list(record.members) if composed else None,
        "parents": list(record.members) if record.kind == "interpolated" else None,
        "bytes": 4 * record.spec.size * (record.spec.k if composed else 1),
        "dimensions": record.frame.dimensions if record.frame else None,
        "frame": Box(**vars(record.frame)) if record.frame else None,
        **_estimates_fields(record.estimates),
        "links": Links(
            self=path,
            points=f"{path}/points",
            mesh=f"{path}/mesh",
            weights=f"{path}/weights",
            photo=f"{path}/photo" if record.has_photo else None,
        ),
    }


def _image_fields(reports: Sequence[Report]) -> dict[str, Any]:
    images = [ImageReport.of(report) for report in reports]
    return {"image": images[0], "images": images if len(images) > 1 else None}


def _estimates_fields(estimates: Estimates | None) -> dict[str, Any]:
    return {**vars(estimates), "camera": vars(estimates.camera)} if estimates else {}


def weights_fields(functions: Functions) -> dict[str, Any]:
    """Return the numbers of functions as base64 of float32, little-endian."""
    arrays = {"weights": functions.theta} | ({"color_weights": functions.color.weights} if functions.color else {})
    return {name: _base64(array) for name, array in arrays.items()}


def _base64(array: Array) -> str:
    return base64.b64encode(np.ascontiguousarray(array, dtype="<f4").tobytes()).decode("ascii")
