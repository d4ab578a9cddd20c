"""Errors as RFC 9457 `application/problem+json`: the one place where an exception becomes an answer."""

import logging
import re
from collections.abc import Mapping, Sequence
from http import HTTPStatus
from typing import Any, Final

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse
from starlette.routing import compile_path

from service.errors import HofError, InvalidParameter, TryLater
from service.schemas import FieldError, Problem

logger: Final = logging.getLogger("hof")

MEDIA_TYPE: Final = "application/problem+json"
HEADERS: Final = {
    408: {"Connection": "close"},
    413: {"Connection": "close"},  # the rest of the body is unread: the connection cannot be used again
    500: {"Connection": "close"},  # the server logs the fault, and closes
}
INTERNAL_DETAIL: Final = "the service failed to answer this request; the fault is in its log"


def install(app: FastAPI) -> None:
    """Make every error of the application answer as a problem."""
    app.exception_handler(HofError)(_domain)
    app.exception_handler(RequestValidationError)(_validation)
    app.exception_handler(HTTPException)(_http)
    app.exception_handler(ClientDisconnect)(_disconnected)
    app.exception_handler(Exception)(_unexpected)


def field_errors(errors: Sequence[Mapping[str, Any]]) -> list[FieldError]:
    """Pydantic's errors as (field, message) pairs; unlike pydantic's they never echo the input."""
    return [
        FieldError(
            field=_path([part for part in error["loc"] if part not in ("query", "path", "body")])[:64],
            message="unknown parameter" if error["type"] == "extra_forbidden" else error["msg"],
        )
        for error in errors
    ]


def _path(parts: Sequence[str | int]) -> str:
    """Where in a request, as one writes it: n, objects[1]."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts).removeprefix(".")


def respond(error: HofError) -> JSONResponse:
    """An error of ours as its answer."""
    errors = [FieldError(field=error.field, message=error.detail)] if error.field else None
    problem = Problem(
        type=_type(error.title), title=error.title, status=error.status, detail=error.detail, errors=errors
    )
    if isinstance(error, TryLater):
        return _respond(problem, {"Retry-After": str(error.retry_after_s)})
    return _respond(problem, HEADERS.get(error.status))


def _respond(
    problem: Problem,
    headers: Mapping[str, str] | None = None,
) -> JSONResponse:
    return JSONResponse(
        problem.model_dump(exclude_none=True), status_code=problem.status, headers=headers, media_type=MEDIA_TYPE
    )


def _type(title: str) -> str:
    return "urn:hof:problem:" + re.sub(r"[^a-z]+", "-", title.lower())


async def _domain(request: Request, error: HofError) -> JSONResponse:
    if error.status == HTTPStatus.INTERNAL_SERVER_ERROR:
        logger.error("%s %s failed", request.method, request.url.path, exc_info=error)
        return await _unexpected(request, error)
    return respond(error)


async def _validation(request: Request, error: RequestValidationError) -> JSONResponse:
    errors = field_errors(error.errors())
    detail = "; ".join(f"{item.field}: {item.message}" for item in errors)
    title = InvalidParameter.title
    return _respond(
        Problem(type=_type(title), title=title, status=InvalidParameter.status, detail=detail, errors=errors)
    )


async def _http(request: Request, error: HTTPException) -> JSONResponse:
    """Starlette's own: no such route, wrong method."""
    title = HTTPStatus(error.status_code).phrase
    problem = Problem(type="about:blank", title=title, status=error.status_code, detail=error.detail)
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED and (allowed := _allowed(request)):
        return _respond(problem, {"Allow": ", ".join(allowed)})
    return _respond(problem, error.headers)


def _allowed(request: Request) -> list[str]:
    """Methods of a path: Starlette knows those of the first route that matches, the schema all."""
    methods = {
        method.upper()
        for path, operations in request.app.openapi()["paths"].items()
        if compile_path(path)[0].fullmatch(request.url.path)
        for method in operations
    }
    return sorted(methods | {"HEAD"} if "GET" in methods else methods)


async def _disconnected(request: Request, error: Exception) -> JSONResponse:
    """The client left while it sent: nobody reads this, but it is no fault of ours."""
    return _respond(Problem(type="about:blank", title="Bad Request", status=400, detail="the body broke off"))


async def _unexpected(request: Request, error: Exception) -> JSONResponse:
    """Anything else: Starlette raises it again afterwards, so that the server logs it."""
    title = HTTPStatus.INTERNAL_SERVER_ERROR.phrase
    problem = Problem(type="about:blank", title=title, status=500, detail=INTERNAL_DETAIL)
    return _respond(problem, HEADERS[500])
