"""The API's schema, as it is served and as it is committed: openapi.json."""

import json
from typing import Any, Final

from fastapi import FastAPI

from service.api.responses import RETRY_AFTER

SECURITY_SCHEMES: Final = {
    "bearer": {"type": "http", "scheme": "bearer", "description": "An API key, where the service has any"},
    "header": {"type": "apiKey", "in": "header", "name": "X-API-Key", "description": "The same"},
}
REFUSALS: Final = {
    "401": "The service has API keys, and the request none that is known",
    "403": "The key lacks the scope: `read` for GET and HEAD, else `write`; for /metrics `metrics`",
    "429": "Too many requests; `Retry-After` tells when there may be another",
}


def openapi_text(app: FastAPI) -> str:
    """The schema of all calls, two spaces an indent, a newline at its end."""
    schema = app.openapi()
    schema["components"]["securitySchemes"] = SECURITY_SCHEMES
    for path, operations in schema["paths"].items():
        for operation in operations.values():
            if not path.startswith(("/health/", "/v2/health/")):
                _add_refusals(operation)
            _name_problems(operation["responses"])
            for parameter in operation.get("parameters", []):
                parameter["schema"] = _without_null(parameter["schema"])
    return json.dumps(schema, indent=2, ensure_ascii=False) + "\n"


def _add_refusals(operation: dict[str, Any]) -> None:
    """Add the refusals of `service.api.middleware.access`, and the credentials it takes, if any."""
    operation["security"] = [{}, *({name: []} for name in SECURITY_SCHEMES)]
    content = {"application/problem+json": {"schema": {"$ref": "#/components/schemas/Problem"}}}
    for status, description in REFUSALS.items():
        told = {"description": description, "content": content}
        operation["responses"].setdefault(status, told | ({"headers": RETRY_AFTER} if status == "429" else {}))


def _name_problems(responses: dict[str, Any]) -> None:
    """FastAPI files every model under application/json; ours of 4xx and 5xx are problem+json."""
    for status, response in responses.items():
        content = response.get("content", {})
        if status >= "400" and "application/json" in content:
            content["application/problem+json"] = content.pop("application/json")


def _without_null(schema: dict[str, Any]) -> dict[str, Any]:
    """A parameter is left out, never null: FastAPI writes Python's None as one more type."""
    types = [option for option in schema.get("anyOf", []) if option != {"type": "null"}]
    rest = {key: value for key, value in schema.items() if key != "anyOf"}
    return {**types[0], **rest} if len(types) == 1 else schema
