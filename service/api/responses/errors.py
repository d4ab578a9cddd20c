"""JSON of errors, and parts of the OpenAPI description of answers that several routes share."""

from typing import Any, Final

from pydantic import BaseModel, Field, computed_field
from pydantic.json_schema import SkipJsonSchema

Responses = dict[int | str, dict[str, Any]]  # of a route, by status, as FastAPI takes them


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
