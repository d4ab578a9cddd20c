"""Admission, declared on the routes: which gate a call needs, so that a full gate refuses it early."""

from collections.abc import Callable, Iterable
from typing import Any, Final, Literal, TypeVar

from fastapi.routing import APIRoute
from starlette.routing import BaseRoute

from service.runtime.admission import Gate, Gates

Endpoint = TypeVar("Endpoint", bound=Callable[..., Any])
GateName = Literal["images", "points"]

_ATTRIBUTE: Final = "needs_gate"


def needs_gate(name: GateName) -> Callable[[Endpoint], Endpoint]:
    """Declare that every call of an endpoint needs room in a gate, which the endpoint takes itself.

    While that gate is full, the access layer refuses the call before a byte of its body is read.
    """

    def declare(endpoint: Endpoint) -> Endpoint:
        setattr(endpoint, _ATTRIBUTE, name)
        return endpoint

    return declare


def declared_gates(routes: Iterable[BaseRoute], gates: Gates) -> dict[tuple[str, str], Gate]:
    """Return the gate that each route declares, by method and template of the path."""
    return {
        (method, route.path): getattr(gates, getattr(route.endpoint, _ATTRIBUTE))
        for route in routes
        if isinstance(route, APIRoute) and hasattr(route.endpoint, _ATTRIBUTE)
        for method in route.methods or ()
    }
