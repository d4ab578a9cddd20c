"""JSON bodies, checked against a model."""

from typing import TypeVar

from fastapi.exceptions import RequestValidationError
from pydantic import BaseModel, ValidationError
from starlette.requests import Request

from service.api.wire.uploads import read_body
from service.errors import InvalidInput

Model = TypeVar("Model", bound=BaseModel)


async def read_json(request: Request, model: type[Model], max_bytes: int) -> Model:
    """Return the body of a request as a model.

    Raises
    ------
    InvalidInput : the body is not JSON.
    RequestValidationError : a field is missing, unknown, of the wrong type or out of range.
    TooLarge : the body exceeds `max_bytes`.
    ClientLeft : the client disconnected before the end of the body.
    """
    body = await read_body(request, max_bytes)
    try:
        return model.model_validate_json(body)
    except ValidationError as error:
        errors = error.errors(include_url=False)
        if errors[0]["type"] == "json_invalid":
            raise InvalidInput("the body is not JSON") from error
        raise RequestValidationError(errors) from error
