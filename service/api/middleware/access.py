"""Access control: API keys, rate limits and full gates, checked by a request's head before its body is read."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.context import RequestContext, client_of, context_of
from service.api.keys import Keys
from service.api.problems import respond, unknown_path
from service.errors import Forbidden, HofError, InvalidKeys, RateLimited, Unauthenticated
from service.runtime.admission import Gate
from service.settings import Settings

if TYPE_CHECKING:
    from service.api.middleware.rate_limit import RateLimit

MAX_DROPPED: Final = 65_536  # bytes of a refused body that are read and dropped: cheaper than another connection

OPEN: Final = frozenset(
    {
        "/",
        "/docs",
        "/embed",
        "/openapi.json",
        "/viewer/{path:path}",
        "/health/live",
        "/health/ready",
        "/v2/health/live",
        "/v2/health/ready",
        "/metrics",
    }
)
VARY: Final = "Authorization, X-API-Key"


class Access:
    """Refuse requests early: 401 without a valid key, 403 without its scope, 429 over the rate limit or a full gate.

    A path without a route is answered 404 here.

    Refusing here costs a third of refusing in the route; goodput under overload depends on it.
    Without a keys file every client has every scope, and the rate limit counts by client address.

    Parameters
    ----------
    gates : the gate that each route needs, by method and template of the path: see `service.api.admission`.
    """

    def __init__(self, app: ASGIApp, settings: Settings, gates: Mapping[tuple[str, str], Gate]) -> None:
        self._app = app
        self._gates = gates
        self._keys = keys_of(settings)
        self._metrics_need_a_key = settings.metrics == "key"
        self._limit = _rate_limit(settings.rate_limit) if settings.rate_limit else None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer it."""
        key_scope = self._key_scope(scope) if scope["type"] == "http" else None
        if key_scope is None:
            await self._app(scope, receive, send)
            return
        extra_headers: dict[str, str] = {}

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.update(extra_headers)
                if self._keys:
                    headers.add_vary_header(VARY)  # a shared cache must not give one client's answer to another
            await send(message)

        try:
            self._check_key(scope, key_scope)
            if self._limit and key_scope != "metrics":
                self._check_rate(self._limit, scope, extra_headers)
            gate = self._gates.get((scope["method"], context_of(scope).route or ""))
            if gate:
                gate.refuse_if_full(client=client_of(scope))
        except HofError as error:
            response = respond(error)
            extra_headers |= _refusal_headers(error, scope, key_scope)
            await response(scope, receive, send_with_headers)
        else:
            # Without a route the right scope is unknown, whatever the router would make of the path (`/metrics%0A`).
            is_known = context_of(scope).route is not None
            app, adds_headers = self._app if is_known else unknown_path(), self._keys or extra_headers
            await app(scope, receive, send_with_headers if adds_headers else send)

    def _key_scope(self, scope: Scope) -> str | None:
        """Return the scope that a key needs for a request; None if the request needs no key."""
        route = context_of(scope).route
        if route == "/metrics" and self._metrics_need_a_key:
            return "metrics"
        if route in OPEN:
            return None
        return "read" if scope["method"] in ("GET", "HEAD") else "write"

    def _check_key(self, scope: Scope, key_scope: str) -> None:
        """Raise Unauthenticated or Forbidden unless the request's key has the scope."""
        if self._keys is None:
            return
        token = _token(Headers(scope=scope))
        if token is None:
            raise Unauthenticated("this call needs an API key: `Authorization: Bearer KEY`, or `X-API-Key: KEY`")
        key = self._keys.find(token.encode("latin-1"))
        if key is None:
            raise Unauthenticated("this API key is not valid here")
        context_of(scope).key = key.name
        if key_scope not in key.scopes:
            raise Forbidden(f"this call needs a key of the scope {key_scope}")

    def _check_rate(self, limit: "RateLimit", scope: Scope, headers: dict[str, str]) -> None:
        """Count the request and add the headers that report the limit. Raises RateLimited."""
        context: RequestContext = context_of(scope)
        client = context.key or client_of(scope) or ""
        is_within = limit.hit(client)
        remaining, wait_s = limit.state(client)
        headers["RateLimit-Policy"] = f'"requests";q={limit.amount};w={limit.window_s}'
        headers["RateLimit"] = f'"requests";r={remaining};t={wait_s}'
        if not is_within:
            context.is_rate_limited = True
            raise RateLimited(f"more than {limit.amount} requests in {limit.window_s} s", retry_after_s=wait_s)


def keys_of(settings: Settings) -> Keys | None:
    """Return the keys of the settings' file; None without a file. Raises InvalidKeys."""
    if settings.api_keys_file is not None:
        return Keys.read(settings.api_keys_file)
    if settings.metrics == "key":
        raise InvalidKeys("--metrics is key, but there is no keys file: name one by --api-keys-file")
    return None


def _rate_limit(text: str) -> "RateLimit":
    from service.api.middleware.rate_limit import RateLimit  # a service without a limit starts sooner

    return RateLimit(text)


def _token(headers: Headers) -> str | None:
    scheme, _, token = headers.get("authorization", "").partition(" ")
    return token.strip() if scheme.lower() == "bearer" else headers.get("x-api-key")


def _refusal_headers(error: HofError, scope: Scope, key_scope: str) -> dict[str, str]:
    headers = {}
    if isinstance(error, Unauthenticated):
        headers["WWW-Authenticate"] = 'Bearer realm="hof"'
    elif isinstance(error, Forbidden):
        headers["WWW-Authenticate"] = f'Bearer realm="hof", error="insufficient_scope", scope="{key_scope}"'
    request_headers = Headers(scope=scope)
    length = request_headers.get("content-length", "0")
    is_small = length.isdecimal() and int(length) <= MAX_DROPPED
    if "transfer-encoding" in request_headers or "expect" in request_headers or not is_small:
        headers["Connection"] = "close"  # the body stays unread
    return headers
