"""Errors as RFC 9457 `application/problem+json`: the one place where an exception becomes an answer."""

import logging
import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from http import HTTPStatus
from typing import Any, Final

from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.routing import compile_path

from service.api.responses.errors import FieldError, Problem
from service.errors import HofError, InvalidParameter, TryLater
from service.runtime.admission import ClientLeft

logger: Final = logging.getLogger("hof")

MEDIA_TYPE: Final = "application/problem+json"
HEADERS: Final = {
    408: {"Connection": "close"},
    413: {"Connection": "close"},  # the rest of the body is unread: the connection cannot be used again
    500: {"Connection": "close"},  # the server logs the fault and closes
}
MAX_ERRORS: Final = 16  # errors that an answer reports; a request may have thousands
MAX_FIELD: Final = 64  # characters of a field's name, which may be the client's
MAX_DETAIL: Final = 1_000  # characters of an error's text, which may repeat a name from a client's file
INTERNAL_DETAIL: Final = "the service failed to answer this request; the fault is in its log"


def install(app: FastAPI) -> None:
    """Make every error of the application answer as a problem."""
    app.exception_handler(HofError)(_domain)
    app.exception_handler(RequestValidationError)(_validation)
    app.exception_handler(HTTPException)(_http)
    app.exception_handler(ClientDisconnect)(_disconnected)
    app.exception_handler(ClientLeft)(_disconnected)
    app.exception_handler(Exception)(_unexpected)


def field_errors(errors: Sequence[Mapping[str, Any]]) -> list[FieldError]:
    """Return pydantic's errors, at most `MAX_ERRORS`, as (field, message) pairs; unlike its own, without the input."""
    return [
        FieldError(
            field=_path([part for part in error["loc"] if part not in ("query", "path", "body")])[:MAX_FIELD],
            message="unknown parameter" if error["type"] == "extra_forbidden" else error["msg"],
        )
        for error in errors[:MAX_ERRORS]
    ]


def _path(parts: Sequence[str | int]) -> str:
    """Return the place in a request as people write it: n, objects[1]."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in parts).removeprefix(".")


def respond(error: HofError) -> Response:
    """Return the answer for one of our errors."""
    field = error.field[:MAX_FIELD] if error.field else None
    body = _body(error.title, error.status, error.detail[:MAX_DETAIL], field)
    headers = {"Retry-After": str(error.retry_after_s)} if isinstance(error, TryLater) else HEADERS.get(error.status)
    return Response(body, error.status, headers, MEDIA_TYPE)


@lru_cache(maxsize=16)  # a service that sheds load repeats the same body thousands of times
def _body(title: str, status: int, detail: str, field: str | None) -> bytes:
    errors = [FieldError(field=field, message=detail)] if field else None
    return _json(Problem(type=problem_type(title), title=title, status=status, detail=detail, errors=errors))


def _respond(problem: Problem, headers: Mapping[str, str] | None = None) -> Response:
    return Response(_json(problem), problem.status, headers, MEDIA_TYPE)


def _json(problem: Problem) -> bytes:
    return problem.model_dump_json(exclude_none=True).encode()


def problem_type(title: str) -> str:
    """Return the URN of a kind of problem."""
    return "urn:hof:problem:" + re.sub(r"[^a-z]+", "-", title.lower())


async def _domain(request: Request, error: HofError) -> Response:
    if error.status == HTTPStatus.INTERNAL_SERVER_ERROR:
        logger.error("%s %s failed", request.method, request.url.path, exc_info=error)
        return await _unexpected(request, error)
    return respond(error)


async def _validation(request: Request, error: RequestValidationError) -> Response:
    every = error.errors()
    errors = field_errors(every)
    detail = "; ".join(f"{item.field}: {item.message}" for item in errors)
    if len(every) > len(errors):
        detail += f"; and {len(every) - len(errors)} more"
    title = InvalidParameter.title
    return _respond(
        Problem(type=problem_type(title), title=title, status=InvalidParameter.status, detail=detail, errors=errors)
    )


def unknown_path() -> Response:
    """Return the answer for a path that the service does not have, which equals Starlette's own."""
    title = HTTPStatus.NOT_FOUND.phrase
    return _respond(Problem(type="about:blank", title=title, status=HTTPStatus.NOT_FOUND, detail=title))


async def _http(request: Request, error: HTTPException) -> Response:
    """Answer Starlette's own errors: no such route, wrong method."""
    title = HTTPStatus(error.status_code).phrase
    problem = Problem(type="about:blank", title=title, status=error.status_code, detail=error.detail)
    if error.status_code == HTTPStatus.METHOD_NOT_ALLOWED and (allowed := _allowed(request)):
        return _respond(problem, {"Allow": ", ".join(allowed)})
    return _respond(problem, error.headers)


def _allowed(request: Request) -> list[str]:
    """Return all methods of a path, from the schema: Starlette knows only those of the first route that matches."""
    methods = {
        method.upper()
        for path, operations in request.app.openapi()["paths"].items()
        if compile_path(path)[0].fullmatch(request.url.path)
        for method in operations
    }
    return sorted(methods | {"HEAD"} if "GET" in methods else methods)


async def _disconnected(request: Request, error: Exception) -> Response:
    """Answer a client that left while it sent: nobody reads this, but it must not count as a fault."""
    return _respond(Problem(type="about:blank", title="Bad Request", status=400, detail="the body broke off"))


async def _unexpected(request: Request, error: Exception) -> Response:
    """Answer any other exception. Starlette raises it again afterwards, so that the server logs it."""
    title = HTTPStatus.INTERNAL_SERVER_ERROR.phrase
    problem = Problem(type="about:blank", title=title, status=500, detail=INTERNAL_DETAIL)
    return _respond(problem, HEADERS[500])
