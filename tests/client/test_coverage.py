"""The clients have every call of openapi.json with every parameter, and every member of its answers."""

import dataclasses
import inspect
import json
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Literal, get_args, get_origin, get_type_hints

import numpy as np
import pytest

from hof_client import AsyncClient, Client, answers, calls, inference_answers
from hof_client.request import Request
from tests.support import ROOT

SCHEMA = json.loads((ROOT / "openapi.json").read_text("utf-8"))
OPERATIONS = [
    (method.upper(), path, call)
    for path, operations in SCHEMA["paths"].items()
    for method, call in operations.items()
    if method in ("get", "post", "put", "patch", "delete")
]
VALUES: Mapping[str, Any] = {
    "image": b"x",
    "photos": [b"x", b"y"],
    "points": b"0 0 0",
    "weights": b"x",
    "object_id": "0" * 32,
    "path": "object.ply",
    "objects": ["0" * 32],
    "start": (-1, 0, 0),
    "goal": (1, 0, 0),
    "name": "hof1-k2",
    "label": "Desk chair",
    "images": np.zeros((1, 3, 4, 4), np.float32),
}
ANSWERS = {
    name: kind
    for module in (answers, inference_answers)
    for name, kind in vars(module).items()
    if dataclasses.is_dataclass(kind)
}


def _builders(client: type) -> dict[str, Callable[..., Any]]:
    """Return the functions behind a client's methods, by the methods' names."""
    return {name: method.__wrapped__ for name, method in vars(client).items() if name in calls.__all__}


def _requests() -> Iterator[tuple[Callable[..., Any], Request]]:
    """Yield the request of each method, with and without the version of a model."""
    for build in _builders(Client).values():
        parameters = inspect.signature(build).parameters
        required = {name: VALUES[name] for name, each in parameters.items() if each.default is each.empty}
        yield build, build(**required).request
        if "version" in parameters:
            yield build, build(**required, version="1").request


def test_methods_of_the_client_cover_all_operations_of_the_schema() -> None:
    covered = {(request.method, request.template) for _, request in _requests()}
    assert covered == {(method, path) for method, path, _ in OPERATIONS}


def test_methods_of_both_clients_are_all_calls() -> None:
    assert _builders(Client) == _builders(AsyncClient) == {name: getattr(calls, name) for name in _builders(Client)}
    assert set(_builders(Client)) == set(calls.__all__) - {"MAX_LIMIT"}


def test_methods_of_the_async_client_are_awaited_or_iterated() -> None:
    methods = [getattr(AsyncClient, name) for name in _builders(AsyncClient)]
    plain = [method.__name__ for method in methods if not inspect.iscoroutinefunction(method)]
    assert plain == ["iter_points"]


def test_method_signature_is_that_of_its_call() -> None:
    for client in (Client("http://x"), AsyncClient("http://x")):
        parameters = inspect.signature(client.points).parameters
        assert list(parameters.items()) == list(inspect.signature(calls.points).parameters.items())
        assert client.points.__doc__ == calls.points.__doc__


@pytest.mark.parametrize(("method", "path", "call"), OPERATIONS, ids=lambda value: str(value)[:40])
def test_query_parameters_of_an_operation_are_those_of_the_methods(
    method: str, path: str, call: Mapping[str, Any]
) -> None:
    declared = {each["name"] for each in call.get("parameters", []) if each["in"] == "query"}
    sent = {
        name
        for _, request in _requests()
        if (request.method, request.template) == (method, path)
        for name in request.query
    }
    assert sent == declared


def test_members_of_json_bodies_are_those_of_the_schema() -> None:
    schemas = {
        path: call["requestBody"]["content"]["application/json"]["schema"]["properties"]
        for _, path, call in OPERATIONS
        if list(call.get("requestBody", {}).get("content", {})) == ["application/json"]
    }
    bodies = [
        (request.template, json.loads(request.content))
        for _, request in _requests()
        if request.template in schemas and request.content
    ]
    for path, properties in schemas.items():
        sent = [body for template, body in bodies if template == path]
        assert {name for body in sent for name in body} == set(properties)
        if "mode" in properties:
            assert {body["mode"] for body in sent} == set(properties["mode"]["enum"])


def test_choices_of_parameters_are_those_of_the_schema() -> None:
    schema = {
        (path, each["name"]): set(_enum(each["schema"]))
        for _, path, call in OPERATIONS
        for each in call.get("parameters", [])
        if each["in"] == "query" and _enum(each["schema"])
    }
    choices: dict[tuple[str, str], set[str]] = {}
    for build, request in _requests():
        for name, hint in get_type_hints(build).items():
            if (request.template, name) in schema:
                choices.setdefault((request.template, name), set()).update(_literals(hint))
    assert choices == schema


@pytest.mark.parametrize("name", sorted(set(SCHEMA["components"]["schemas"]) - {"Problem"}))
def test_members_of_an_answer_are_those_of_the_schema(name: str) -> None:
    schema = SCHEMA["components"]["schemas"][name]
    hints = get_type_hints(ANSWERS[name])
    assert set(hints) == set(schema["properties"])
    optional = {field for field, hint in hints.items() if type(None) in get_args(hint)}
    nullable = {field for field, each in schema["properties"].items() if {"type": "null"} in each.get("anyOf", [])}
    defaults = {field for field, each in schema["properties"].items() if "default" in each or "const" in each}
    assert optional - nullable == set(hints) - set(schema["required"]) - defaults


def test_answers_that_the_schema_lacks_are_none() -> None:
    assert set(ANSWERS) - set(SCHEMA["components"]["schemas"]) == set()


def _enum(schema: Mapping[str, Any]) -> list[str]:
    values: list[str] = schema.get("enum") or ([schema["const"]] if "const" in schema else [])
    return values


def _literals(hint: object) -> Iterator[str]:
    """Yield the strings of all literals in an annotation."""
    if get_origin(hint) is Literal:
        yield from get_args(hint)
    else:
        for part in get_args(hint):
            yield from _literals(part)
