"""OpenAPI schema of the service, as it is served and as it is committed: openapi.json."""

import json
from typing import Any, Final

from fastapi import FastAPI

from service.api.examples import parameter_example, problem_example
from service.api.responses.errors import RETRY_AFTER

SECURITY_SCHEMES: Final = {
    "bearer": {"type": "http", "scheme": "bearer", "description": "An API key, if the service has a keys file"},
    "header": {"type": "apiKey", "in": "header", "name": "X-API-Key", "description": "The same API key"},
}
REFUSALS: Final = {
    "401": "The service has API keys, and the request has no valid one",
    "403": "The key lacks the scope: `read` for GET and HEAD, `metrics` for /metrics, otherwise `write`. Without keys: "
    "a page of another site may not change this service",
    "421": "The service has no keys and does not answer for this host name",
    "429": "Too many requests; `Retry-After` says when to try again",
}


def openapi_text(app: FastAPI) -> str:
    """Return the schema of all calls as JSON, indented by two spaces, with a newline at its end."""
    schema = app.openapi()
    schema["components"]["securitySchemes"] = SECURITY_SCHEMES
    for path, operations in schema["paths"].items():
        for operation in operations.values():
            if not path.startswith(("/health/", "/v2/health/")):
                _add_refusals(operation)
            _name_problems(operation["responses"])
            for parameter in operation.get("parameters", []):
                parameter["schema"] = _without_null(parameter["schema"])
                parameter["example"] = parameter_example(parameter)
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def _add_refusals(operation: dict[str, Any]) -> None:
    """Add the refusals of `service.api.middleware.access` and the optional credentials."""
    operation["security"] = [{}, *({name: []} for name in SECURITY_SCHEMES)]
    content = {"application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}}
    for status, description in REFUSALS.items():
        headers = {"headers": RETRY_AFTER} if status == "429" else {}
        operation["responses"].setdefault(status, {"description": description, "content": content, **headers})


def _name_problems(responses: dict[str, Any]) -> None:
    """Move the models of 4xx and 5xx from application/json, where FastAPI lists them, to application/problem+json.

    Each gets an example.
    """
    for status, response in responses.items():
        content = response.get("content", {})
        if status >= "400" and "application/json" in content:
            content["application/problem+json"] = content.pop("application/json")
        if "application/problem+json" in content:
            problem = content["application/problem+json"] | {"example": problem_example(status)}
            response["content"] = {**content, "application/problem+json": problem}  # several statuses share `content`


def _without_null(schema: dict[str, Any]) -> dict[str, Any]:
    """Return a parameter's schema without the type null, which FastAPI adds for None: parameters are never null."""
    types = [option for option in schema.get("anyOf", []) if option != {"type": "null"}]
    rest = {key: value for key, value in schema.items() if key != "anyOf"}
    return {**types[0], **rest} if len(types) == 1 else schema
