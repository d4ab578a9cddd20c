"""The schema: as committed, complete, and true."""

import json
from pathlib import Path
from typing import Any

import httpx
import pytest
from jsonschema_rs import is_valid

from service.api.app import create_app
from service.api.openapi import openapi_text
from service.api.responses.errors import Problem
from service.settings import Settings

COMMITTED = Path(__file__).parents[3] / "openapi.json"


def test_schema_served_equals_the_committed_one(client: httpx.Client) -> None:
    answer = client.get("/openapi.json")
    assert answer.headers["content-type"] == "application/json"
    assert answer.content == COMMITTED.read_bytes(), "run `hof openapi > openapi.json`"


def test_schema_with_other_settings_is_the_same() -> None:
    assert openapi_text(create_app(Settings(max_points=5, max_image_bytes=7))).encode() == COMMITTED.read_bytes()


@pytest.fixture(scope="module")
def operations() -> dict[str, dict[str, Any]]:
    paths = json.loads(COMMITTED.read_text())["paths"]
    return {f"{method.upper()} {path}": each for path, methods in paths.items() for method, each in methods.items()}


def test_schema_lists_the_calls_of_the_contract(operations: dict[str, dict[str, Any]]) -> None:
    assert operations.keys() == {
        "POST /encode",
        "POST /compose",
        "GET /objects",
        "POST /objects",
        "GET /objects/{id}",
        "DELETE /objects/{id}",
        "GET /objects/{id}/points",
        "GET /objects/{id}/mesh",
        "PATCH /objects/{id}",
        "GET /objects/{id}/picture",
        "GET /objects/{id}/photo",
        "GET /objects/{id}/weights",
        "POST /objects/{id}/path",
        "GET /model",
        "GET /models",
        "GET /health/live",
        "GET /health/ready",
        "GET /metrics",
        "GET /v2",
        "GET /v2/health/live",
        "GET /v2/health/ready",
        "GET /v2/models/{name}",
        "GET /v2/models/{name}/config",
        "GET /v2/models/{name}/ready",
        "POST /v2/models/{name}/infer",
        "GET /v2/models/{name}/versions/{version}",
        "GET /v2/models/{name}/versions/{version}/config",
        "GET /v2/models/{name}/versions/{version}/ready",
        "POST /v2/models/{name}/versions/{version}/infer",
    }


def test_schema_documents_every_error_as_a_problem(operations: dict[str, dict[str, Any]]) -> None:
    for name, operation in operations.items():
        assert "422" in operation["responses"], name
        for status, response in operation["responses"].items():
            if status >= "400":
                (media_type, content), *rest = response["content"].items()
                assert (media_type, rest) == ("application/problem+json", []), (name, status)
                assert content["schema"] == {"$ref": "#/components/schemas/Problem"}


def test_schema_documents_which_calls_need_a_key(operations: dict[str, dict[str, Any]]) -> None:
    open_ = {"GET /health/live", "GET /health/ready", "GET /v2/health/live", "GET /v2/health/ready"}
    assert {name for name, operation in operations.items() if "security" not in operation} == open_
    for name in operations.keys() - open_:
        assert operations[name]["security"] == [{}, {"bearer": []}, {"header": []}]
        assert {"401", "403", "429"} <= operations[name]["responses"].keys()
    assert json.loads(COMMITTED.read_text())["components"]["securitySchemes"].keys() == {"bearer", "header"}


def test_schema_documents_points_with_each_media_type(operations: dict[str, dict[str, Any]]) -> None:
    content = operations["GET /objects/{id}/points"]["responses"]["200"]["content"]
    assert content.keys() == {
        "model/ply",
        "application/x-npy",
        "text/plain",
        "application/json",
        "model/gltf-binary",
        "model/gltf+json",
        "application/x-pcd",
        "application/octet-stream",
    }


def test_schema_documents_the_body_of_encode(operations: dict[str, dict[str, Any]]) -> None:
    assert operations["POST /encode"]["requestBody"]["content"].keys() == {
        "multipart/form-data",
        "image/png",
        "image/jpeg",
        "image/webp",
        "image/avif",
        "image/heic",
        "model/gltf-binary",
        "model/obj",
        "model/stl",
        "application/octet-stream",
    }


def test_schema_documents_the_body_of_compose(operations: dict[str, dict[str, Any]]) -> None:
    schema = operations["POST /compose"]["requestBody"]["content"]["application/json"]["schema"]
    assert schema["required"] == ["objects"]
    assert schema["properties"]["mode"]["enum"] == ["compose", "interpolate", "all"]


def test_schema_describes_every_parameter_without_null(operations: dict[str, dict[str, Any]]) -> None:
    for operation in operations.values():
        for parameter in operation.get("parameters", []):
            assert parameter["description"]
            assert "anyOf" not in parameter["schema"], parameter["name"]


def test_schema_shows_a_valid_example_of_every_parameter(operations: dict[str, dict[str, Any]]) -> None:
    for name, operation in operations.items():
        for parameter in operation.get("parameters", []):
            assert is_valid(parameter["schema"], parameter["example"]), (name, parameter["name"])


def test_schema_shows_an_example_of_every_error(operations: dict[str, dict[str, Any]]) -> None:
    for operation in operations.values():
        for status, response in operation["responses"].items():
            if status >= "400":
                example = response["content"]["application/problem+json"]["example"]
                problem = Problem.model_validate({key: example[key] for key in example if key != "error"})
                assert problem.status == int(status)
                assert problem.model_dump(exclude_none=True) == example


def test_docs_page_shows_the_schema(client: httpx.Client) -> None:
    answer = client.get("/docs")
    assert answer.headers["content-type"].startswith("text/html")
    assert 'data-schema="openapi.json"' in answer.text
