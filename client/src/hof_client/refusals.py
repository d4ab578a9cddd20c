"""Answers that are errors: problem+json, or a proxy's page, to an exception of the tree in `hof_client.problems`."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from http import HTTPStatus
from typing import Final

import httpx

from hof_client import problems
from hof_client.answers import FieldError
from hof_client.parsing import parse
from hof_client.problems import (
    LATER,
    ConnectionFailed,
    HofError,
    Problem,
    TimedOut,
    Truncated,
    TryLater,
    UnexpectedAnswer,
    Unreachable,
)

LARGE_BYTES: Final = 1_000_000  # of a body that the service may refuse for its size
MAX_TEXT: Final = 200  # characters of an answer that is no problem+json

_KINDS: Final = [kind for kind in vars(problems).values() if isinstance(kind, type) and issubclass(kind, Problem)]
_BY_TYPE: Final = {"urn:hof:problem:" + kind.title.lower().replace(" ", "-"): kind for kind in _KINDS if kind.title}
_BY_STATUS: Final = {kind.status: kind for kind in _KINDS if kind.__base__ is Problem and kind.status}


def error_of(response: httpx.Response) -> HofError:
    """Return the error that a read answer stands for: a `Problem`, or `UnexpectedAnswer` for a redirection."""
    status = response.status_code
    if status < HTTPStatus.BAD_REQUEST:
        target = response.headers.get("location", "nowhere")
        return UnexpectedAnswer(f"the service answered {status}, a redirection to {target}: give its own base URL")
    members = _members(response)
    type_ = str(members.get("type", "about:blank"))
    fallback = TryLater if status in LATER else _BY_STATUS.get(status, Problem)
    problem = _BY_TYPE.get(type_, fallback)(
        str(members.get("detail") or response.text[:MAX_TEXT].strip() or "the answer has no text"),
        type=type_,
        title=str(members.get("title") or response.reason_phrase or "Error"),
        status=status,
        errors=_field_errors(members.get("errors")),
        request_id=response.headers.get("x-request-id", ""),
    )
    if isinstance(problem, TryLater):
        problem.retry_after_s = seconds_of(response.headers.get("retry-after"))
    return problem


def check_media_type(response: httpx.Response, media_type: str) -> None:
    """Raise UnexpectedAnswer unless an answer is of a type; "" stands for any."""
    actual = response.headers.get("content-type", "").partition(";")[0].strip()
    if media_type and actual != media_type:
        url = response.request.url
        raise UnexpectedAnswer(f"{url} answered {actual or 'no type'} instead of {media_type}: is this a HOF service?")


def seconds_of(retry_after: str | None) -> float | None:
    """Return the seconds of a Retry-After header (RFC 9110, section 10.2.3): a number or a date; None without one."""
    text = (retry_after or "").strip()
    if text.isascii() and text.isdecimal():
        return float(text)
    try:
        date = parsedate_to_datetime(text)
    except ValueError:
        return None
    date = date if date.tzinfo else date.replace(tzinfo=UTC)
    return max(0.0, (date - datetime.now(UTC)).total_seconds())


@contextmanager
def raising_ours(*, is_answered: bool = False) -> Iterator[None]:
    """Raise httpx's errors as ours; `is_answered` says that an answer has begun."""
    try:
        yield
    except (httpx.ConnectError, httpx.ConnectTimeout, httpx.ProxyError) as error:
        raise Unreachable(f"no connection to {_host(error)}: {_text(error)}") from error
    except httpx.TimeoutException as error:
        raise TimedOut(f"{_host(error)} did not answer in time: {_text(error)}; see timeout_s") from error
    except httpx.TransportError as error:
        if is_answered:
            raise Truncated(f"the answer of {_host(error)} broke off: {_text(error)}") from error
        raise ConnectionFailed(f"the connection to {_host(error)} broke: {_text(error)}{_hint(error)}") from error
    except httpx.DecodingError as error:
        raise UnexpectedAnswer(f"the answer of {_host(error)} cannot be decompressed: {_text(error)}") from error


def _members(response: httpx.Response) -> Mapping[str, object]:
    if not response.headers.get("content-type", "").startswith("application/problem+json"):
        return {}
    try:
        members = json.loads(response.content)
    except ValueError:
        return {}
    return members if isinstance(members, dict) else {}


def _field_errors(items: object) -> tuple[FieldError, ...]:
    try:
        return tuple(parse(FieldError, item) for item in items) if isinstance(items, list) else ()
    except ValueError:
        return ()


def _host(error: httpx.RequestError) -> str:
    url = error.request.url
    return f"{url.scheme}://{url.netloc.decode()}"  # without user and password


def _hint(error: httpx.RequestError) -> str:
    """Return a reason that a large body may have: asyncio's sockets lose an answer that comes while they still send."""
    size = int(error.request.headers.get("content-length", "0"))
    return f"; its limit may be below the {size} bytes of the body" if size > LARGE_BYTES else ""


def _text(error: Exception) -> str:
    return str(error) or type(error).__name__
