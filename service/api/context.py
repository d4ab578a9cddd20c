"""The request context: what the middleware learns about a request, for other middleware, the routes and the log."""

from collections.abc import MutableMapping
from dataclasses import dataclass
from typing import Any, Final

_SCOPE_KEY: Final = "hof.context"


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
