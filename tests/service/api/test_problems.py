"""Every error answers as RFC 9457 problem+json and gives nothing away."""

import asyncio
from collections.abc import Iterator

import httpx
import pytest
from fastapi import FastAPI

from service import errors
from service.api import problems
from tests.support.slow import until


def _classes(root: type[errors.HofError] = errors.HofError) -> Iterator[type[errors.HofError]]:
    yield root
    for child in root.__subclasses__():
        yield from _classes(child)


def _answer(error: Exception) -> httpx.Response:
    """Answer of an application whose one call raises."""
    app = FastAPI()
    problems.install(app)

    @app.get("/")
    async def fail() -> None:
        raise error

    async def ask() -> httpx.Response:
        transport = httpx.ASGITransport(app, raise_app_exceptions=False)
        async with httpx.AsyncClient(transport=transport, base_url="http://x") as client:
            return await client.get("/")

    return asyncio.run(ask())


@pytest.mark.parametrize("kind", list(_classes()), ids=lambda kind: kind.__name__)
def test_error_of_every_class_answers_with_its_status(kind: type[errors.HofError]) -> None:
    answer = _answer(kind("the detail", field="name"))
    problem = answer.json()
    assert answer.headers["content-type"] == "application/problem+json"
    assert answer.status_code == problem["status"] == kind.status
    if kind.status == 500:
        assert "detail" not in problem["detail"]
        assert "errors" not in problem
    else:
        assert problem["title"] == kind.title
        assert problem["type"] == "urn:hof:problem:" + kind.title.lower().replace(" ", "-")
        assert problem["detail"] == "the detail"
        assert problem["errors"] == [{"field": "name", "message": "the detail"}]


def test_error_without_a_field_lists_no_errors() -> None:
    assert "errors" not in _answer(errors.NotFound("x")).json()


def test_not_ready_answers_with_retry_after() -> None:
    assert _answer(errors.NotReady("x")).headers["retry-after"] == "1"


def test_unexpected_exception_answers_500_without_details() -> None:
    answer = _answer(RuntimeError("/secret/path"))
    assert (answer.status_code, answer.headers["content-type"]) == (500, "application/problem+json")
    assert answer.json() == {
        "type": "about:blank",
        "title": "Internal Server Error",
        "status": 500,
        "detail": problems.INTERNAL_DETAIL,
        "error": problems.INTERNAL_DETAIL,
    }


def test_store_fault_answers_500_without_a_path_and_is_logged(
    client: httpx.Client, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async def broken(*_: object) -> None:
        raise OSError(5, "Input/output error", "/var/lib/hof.db")

    monkeypatch.setattr("service.storage.store.Store.page", broken)
    answer = client.get("/objects")
    assert answer.status_code == 500
    assert "hof.db" not in answer.text
    assert "Traceback" not in answer.text
    # the server logs after it has answered
    until(lambda: any(record.exc_info and "hof.db" in str(record.exc_info[1]) for record in caplog.records))


@pytest.mark.parametrize(("method", "path"), [("GET", "/nope"), ("GET", "/objects/"), ("POST", "/encode/x")])
def test_unknown_route_answers_404(client: httpx.Client, method: str, path: str) -> None:
    answer = client.request(method, path)
    assert (answer.status_code, answer.headers["content-type"]) == (404, "application/problem+json")
    assert answer.json()["title"] == "Not Found"


@pytest.mark.parametrize(
    ("method", "path", "allow"),
    [
        ("GET", "/encode", "POST"),
        ("HEAD", "/encode", "POST"),
        ("PUT", "/objects", "GET, HEAD, POST"),
        ("POST", "/objects/0", "DELETE, GET, HEAD, PATCH"),
        ("DELETE", "/objects/0/points", "GET, HEAD"),
        ("POST", "/health/live", "GET, HEAD"),
    ],
)
def test_wrong_method_answers_405_with_the_allowed_ones(
    client: httpx.Client, method: str, path: str, allow: str
) -> None:
    answer = client.request(method, path)
    assert (answer.status_code, answer.headers["allow"]) == (405, allow)
    assert answer.headers["content-type"] == "application/problem+json"


@pytest.mark.parametrize("path", ["/health/live", "/health/ready", "/model", "/objects"])
def test_unknown_parameter_is_refused_by_name(client: httpx.Client, path: str) -> None:
    answer = client.get(f"{path}?nope=1")
    assert answer.status_code == 422
    assert {"field": "nope", "message": "unknown parameter"} in answer.json()["errors"]


def test_faulty_value_is_not_repeated_in_the_answer(client: httpx.Client) -> None:
    assert "<script>" not in client.get("/objects?limit=<script>").text


def test_repeated_parameter_is_refused(client: httpx.Client) -> None:
    answer = client.get("/objects?limit=1&limit=2&limit=3")
    assert (answer.status_code, answer.headers["content-type"]) == (422, "application/problem+json")
    assert answer.json()["errors"] == [{"field": "limit", "message": "a parameter may be given once"}]
