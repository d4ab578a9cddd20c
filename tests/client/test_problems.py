"""The tree of errors is the service's, and every answer that is an error becomes one of its classes."""

import pickle
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from typing import TypeVar

import httpx
import pytest

from hof_client import Client, problems
from hof_client.refusals import error_of, seconds_of
from service import errors
from service.api.problems import respond

T = TypeVar("T")


def _below(root: type[T]) -> Iterator[type[T]]:
    """Yield all classes below one."""
    for kind in root.__subclasses__():
        yield kind
        yield from _below(kind)


def _row(kind: type) -> tuple[str, str, int | None, str]:
    """Return a class's name, its parent's, and the status and title of its own."""
    parent = kind.__base__.__name__ if kind.__base__ else ""
    return kind.__name__, parent, vars(kind).get("status"), vars(kind).get("title", "")


ANSWERED = [kind for kind in _below(errors.HofError) if kind.status != 500]


def test_tree_of_problems_equals_the_tree_of_the_service() -> None:
    served = [kind for kind in _below(errors.HofError) if kind in ANSWERED or set(ANSWERED) & set(_below(kind))]
    rows = [_row(kind) for kind in served]
    expected = [(name, "Problem" if parent == "HofError" else parent, *own) for name, parent, *own in rows]
    assert sorted(_row(kind) for kind in _below(problems.Problem)) == sorted(expected)


def test_tree_in_the_docstring_names_every_class() -> None:
    drawing = problems.__doc__ or ""
    classes = [name for name, kind in vars(problems).items() if isinstance(kind, type) and name != "FieldError"]
    assert [name for name in classes if f" {name} " not in drawing.replace("\n", " ")] == []


@pytest.mark.parametrize("kind", ANSWERED, ids=lambda kind: kind.__name__)
def test_error_of_the_service_becomes_the_class_of_its_name(kind: type[errors.HofError]) -> None:
    answer = respond(kind("n: too large", field="n"))
    response = httpx.Response(answer.status_code, headers=dict(answer.headers), content=bytes(answer.body))
    error = error_of(response)
    assert type(error).__name__ == kind.__name__
    assert isinstance(error, problems.Problem)
    assert (error.status, error.title, error.detail) == (kind.status, kind.title, "n: too large")
    assert [(each.field, each.message) for each in error.errors] == [("n", "n: too large")]
    assert getattr(error, "retry_after_s", None) == (1.0 if issubclass(kind, errors.TryLater) else None)
    assert str(error) == f"{kind.status} {kind.title}: n: too large"
    assert vars(pickle.loads(pickle.dumps(error))) == vars(error)


@pytest.mark.parametrize(
    ("status", "body", "kind", "detail"),
    [
        (404, b'{"type":"about:blank","title":"Not Found","status":404,"detail":"Not Found"}', "NotFound", "Not Found"),
        (400, b'{"type":"about:blank","title":"Bad Request","status":400,"detail":"x"}', "InvalidInput", "x"),
        (
            500,
            b'{"type":"about:blank","title":"Internal Server Error","detail":"see the log"}',
            "Problem",
            "see the log",
        ),
        (422, b'{"type":"urn:hof:problem:of-the-future","title":"New","detail":"x"}', "InvalidParameter", "x"),
        (418, b"[1]", "Problem", "[1]"),
        (503, b"{", "TryLater", "{"),
        (502, b"", "TryLater", "the answer has no text"),
        (422, b'{"detail":"x","errors":[{"field":1}]}', "InvalidParameter", "x"),
    ],
)
def test_error_of_an_unknown_kind_becomes_the_class_of_its_status(
    status: int, body: bytes, kind: str, detail: str
) -> None:
    error = error_of(httpx.Response(status, headers={"Content-Type": "application/problem+json"}, content=body))
    assert (type(error).__name__, getattr(error, "status", 0), getattr(error, "detail", "")) == (kind, status, detail)


def test_page_of_a_proxy_becomes_a_problem_with_its_text() -> None:
    page = "<html>" + "bad gateway " * 100
    error = error_of(httpx.Response(502, headers={"Content-Type": "text/html", "X-Request-ID": "7"}, text=page))
    assert isinstance(error, problems.TryLater)
    assert (error.title, error.request_id, len(error.detail) <= 200) == ("Bad Gateway", "7", True)


def test_redirection_is_no_answer_of_the_service() -> None:
    error = error_of(httpx.Response(308, headers={"Location": "https://elsewhere/"}))
    assert isinstance(error, problems.UnexpectedAnswer)
    assert "https://elsewhere/" in str(error)


@pytest.mark.parametrize(
    ("header", "seconds"),
    [(None, None), ("", None), ("0", 0), (" 17 ", 17), ("-1", None), ("soon", None), ("1.5", None), ("²", None)],
)
def test_seconds_of_retry_after_are_its_number_if_it_is_one(header: str | None, seconds: float | None) -> None:
    assert seconds_of(header) == seconds


def test_seconds_of_a_date_are_those_until_then() -> None:
    now = datetime.now(UTC)
    for date, least, most in ((now + timedelta(seconds=90), 80, 90), (now - timedelta(days=1), 0, 0)):
        assert least <= (seconds_of(format_datetime(date, usegmt=True)) or 0) <= most
        assert least <= (seconds_of(format_datetime(date.replace(tzinfo=None))) or 0) <= most


@pytest.mark.parametrize("url", ["", "localhost:8080", "ftp://localhost"])
def test_base_url_without_http_is_refused(url: str) -> None:
    with pytest.raises(ValueError, match="must begin with http"):
        Client(url)


@pytest.mark.parametrize("object_id", ["", ".", ".."])
def test_id_that_would_change_the_path_is_refused(object_id: str) -> None:
    with Client("http://127.0.0.1:9") as client, pytest.raises(ValueError, match="names nothing"):
        client.delete(object_id)


def test_key_is_not_shown() -> None:
    assert "hof_secret" not in repr(Client("http://localhost", api_key="hof_secret"))
