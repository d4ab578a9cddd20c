"""Queries of any path are bounded before they are parsed."""

import httpx
import pytest

from service.api.middleware.query import MAX_PARAMETERS
from service.api.problems import MAX_ERRORS, MAX_FIELD

PATHS = ["/health/live", "/docs", "/openapi.json", "/viewer/main.js", "/objects", "/model", "/v2"]


def _query(count: int) -> str:
    return "&".join(f"p{number}=1" for number in range(count))


@pytest.mark.parametrize("path", PATHS)
def test_query_of_too_many_parameters_is_refused_on_any_path(client: httpx.Client, path: str) -> None:
    answer = client.get(f"{path}?{_query(8_000)}")
    assert (answer.status_code, answer.headers["content-type"]) == (422, "application/problem+json")
    assert answer.json()["detail"] == f"the query has 8000 parameters, at most {MAX_PARAMETERS} are allowed"
    assert len(answer.content) < 1_000


def test_query_of_an_unknown_path_is_not_parsed(client: httpx.Client) -> None:
    answer = client.get(f"/nope?{_query(8_000)}")
    assert answer.status_code == 404
    assert len(answer.content) < 1_000


@pytest.mark.parametrize("separators", ["&" * 30_000, "&=" * 20_000])
def test_query_of_empty_parameters_is_refused(client: httpx.Client, separators: str) -> None:
    assert client.get(f"/health/live?{separators}").status_code == 422


def test_query_of_the_most_parameters_reports_16_faults(client: httpx.Client) -> None:
    problem = client.get(f"/objects?{_query(MAX_PARAMETERS)}").json()
    assert len(problem["errors"]) == MAX_ERRORS == 16
    assert problem["detail"].endswith("; and 48 more")


def test_query_of_long_names_and_values_is_not_repeated(client: httpx.Client) -> None:
    query = "&".join(f"{letter * 900}={'z' * 900}" for letter in "abcdefghijklmnop")
    answer = client.get(f"/objects?{query}")
    assert answer.status_code == 422
    assert {len(error["field"]) for error in answer.json()["errors"]} == {MAX_FIELD}
    assert "zz" not in answer.text
    assert len(answer.content) < 8_000


def test_query_with_a_long_repeated_name_reports_its_beginning(client: httpx.Client) -> None:
    answer = client.get(f"/objects?{'a' * 9_000}=1&{'a' * 9_000}=2")
    assert answer.json()["errors"] == [{"field": "a" * MAX_FIELD, "message": "a parameter may be given once"}]


def test_json_body_of_many_faults_reports_16(client: httpx.Client) -> None:
    body = "{" + ",".join(f'"m{number}":1' for number in range(1_000)) + "}"
    answer = client.post("/compose", content=body)
    assert answer.status_code == 422
    assert len(answer.json()["errors"]) == MAX_ERRORS
    assert len(answer.content) < 4_000
