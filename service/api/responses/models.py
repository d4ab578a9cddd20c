"""JSON of the loaded models."""

from dataclasses import asdict
from typing import Any

from pydantic import BaseModel, Field
from pydantic.json_schema import SkipJsonSchema

from service.api.responses.parts import ColorSpec, Spec
from service.encoding.encoder import Encoder


class ModelFraming(BaseModel):
    """Framing of the images of a model."""

    size: int = Field(description="side of the encoder's input, pixels", examples=[64])
    foreground_ratio: float = Field(examples=[0.85])


class Model(BaseModel):
    """A loaded model."""

    name: str = Field(examples=["hof1-k2"])
    digest: str = Field(description="sha256 of the model file, hexadecimal")
    spec: Spec
    color: ColorSpec = None
    framing: ModelFraming | SkipJsonSchema[None] = Field(
        default=None,
        exclude_if=lambda value: value is None,
        description="of the images that it takes; absent if it takes points",
    )
    points: int | SkipJsonSchema[None] = Field(
        default=None,
        exclude_if=lambda value: value is None,
        description="number of points that it sees of those that are sent; absent if it takes images",
        examples=[2048],
    )
    card: dict[str, Any] = Field(description="the model card as the file carries it: data, license, figures, limits")

    @classmethod
    def of(cls, encoder: Encoder) -> "Model":
        """Return the JSON form of an encoder."""
        return cls(
            name=encoder.name,
            digest=encoder.digest,
            spec=Spec.of(encoder.spec),
            color=Spec.of(encoder.color_spec) if encoder.color_spec else None,
            framing=ModelFraming(**asdict(encoder.framing)) if encoder.takes == "image" else None,
            points=encoder.count,
            card=encoder.card,
        )


class ModelList(BaseModel):
    """The loaded models."""

    models: list[Model] = Field(description="the first is the default of calls that name no model")
