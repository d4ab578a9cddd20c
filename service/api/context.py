"""The request context: what the middleware learns about a request, for other middleware, the routes and the log."""

import socket
from collections.abc import MutableMapping
from dataclasses import dataclass
from typing import Any, Final

IPV4_IN_IPV6: Final = bytes(10) + b"\xff\xff"  # RFC 4291, 2.5.5.2
_SCOPE_KEY: Final = "hof.context"
_REFUSAL_KEY: Final = "hof.refusal"


@dataclass
class RequestContext:
    """Facts about one request.

    Attributes
    ----------
    route : template of the path, for example `/objects/{id}`; None for a path that the service does not have.
    is_head : the method is HEAD, which is answered as GET: nobody sees the body, so it need not be computed.
    key : name of the API key; None for a request without one.
    is_rate_limited : the request exceeded the rate limit.
    """

    route: str | None
    is_head: bool = False
    key: str | None = None
    is_rate_limited: bool = False


def attach(scope: MutableMapping[str, Any], context: RequestContext) -> None:
    """Attach the context to an ASGI scope."""
    scope[_SCOPE_KEY] = context


def context_of(scope: MutableMapping[str, Any]) -> RequestContext:
    """Return the context of an ASGI scope, which `service.api.middleware.observe` attached."""
    context: RequestContext = scope[_SCOPE_KEY]
    return context


def note_refusal(scope: MutableMapping[str, Any], status: int) -> None:
    """Note in an ASGI scope that the server itself answered the request while it was received."""
    scope[_REFUSAL_KEY] = status


def refusal_of(scope: MutableMapping[str, Any]) -> int | None:
    """Return the status that the server itself answered with; None if it leaves the answer to the application."""
    status: int | None = scope.get(_REFUSAL_KEY)
    return status


def client_of(scope: MutableMapping[str, Any]) -> str | None:
    """Return by what a request's client is counted; None if its address is unknown.

    That is its IPv4 address, or the network of 64 bits of its IPv6 address: a host has all addresses of such a network.
    """
    client: tuple[str, int] | None = scope.get("client")
    return _network_of(client[0]) if client else None


def _network_of(address: str) -> str:
    if ":" not in address:
        return address
    try:
        packed = socket.inet_pton(socket.AF_INET6, address.partition("%")[0])
    except (OSError, ValueError):  # whatever a trusted proxy wrote
        return address
    if packed.startswith(IPV4_IN_IPV6):
        return socket.inet_ntop(socket.AF_INET, packed[len(IPV4_IN_IPV6) :])
    return f"{socket.inet_ntop(socket.AF_INET6, packed[:8] + bytes(8))}/64"
