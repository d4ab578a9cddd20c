"""JSON of objects that are completed from points."""

from dataclasses import asdict
from typing import Any

from pydantic import BaseModel, Field
from pydantic.json_schema import SkipJsonSchema

from service.api.responses.objects import StoredObject, Weights64, object_fields, weights_fields
from service.api.responses.parts import Box, Dimensions, Spec
from service.mapping.frame import Frame
from service.mapping.spec import Functions, MappingSpec
from service.runtime.inputs import scans
from service.storage.rows import Record


class Placement(BaseModel):
    """The object's place in the frame of the points that were sent.

    A point of the object frame, turned about +Y by `turn` degrees, is p there, and lies at `scale` p + `center`.
    """

    center: tuple[float, float, float] = Field(examples=[(0.1, 0.4, 2.0)])
    scale: float = Field(description="longest side of the object, in the unit of the points", examples=[0.9])
    turn: float = Field(description="degrees about +Y, from +Z to +X; 0 if the front looks along +Z", examples=[90.0])
    count: int = Field(description="number of points; of a mesh, that were sampled from its surface", examples=[2048])

    @classmethod
    def of(cls, placement: scans.Placement) -> "Placement":
        """Return the JSON form of a placement."""
        return cls(**asdict(placement))


class CompletedObject(StoredObject):
    """An object that points are a part of, its place in their frame, and its weights if `include=weights`."""

    placement: Placement
    weights: Weights64 | SkipJsonSchema[None] = None

    @classmethod
    def of_points(
        cls, record: Record, placement: scans.Placement, functions: Functions | None, root_path: str | None
    ) -> "CompletedObject":
        """Return the JSON form of a record, for the client that sent the points."""
        weights: dict[str, Any] = weights_fields(functions) if functions else {}
        return cls(**object_fields(record, root_path), placement=Placement.of(placement), **weights)


class CompletedWeights(BaseModel):
    """The answer to points with `store=false`: theta itself; nothing is kept."""

    model: str = Field(examples=["hof1-k2-points"])
    spec: Spec
    bytes: int = Field(examples=[28684])
    dimensions: Dimensions
    frame: Box
    placement: Placement
    weights: Weights64

    @classmethod
    def of(
        cls, model: str, spec: MappingSpec, functions: Functions, box: Frame, placement: scans.Placement
    ) -> "CompletedWeights":
        """Return the JSON form of functions that are not kept."""
        return cls(
            model=model,
            spec=Spec.of(spec),
            bytes=functions.theta.nbytes,
            dimensions=box.dimensions,
            frame=Box(**asdict(box)),
            placement=Placement.of(placement),
            **weights_fields(functions),
        )
