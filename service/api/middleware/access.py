"""Who may call what, and how often: decided by a request's headers, before a byte of its body is read."""

import math
import time
from typing import Final

from fastapi import FastAPI
from limits import RateLimitItem, parse
from limits.storage import MemoryStorage
from limits.strategies import SlidingWindowCounterRateLimiter
from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.keys import Keys
from service.api.problems import respond
from service.errors import Forbidden, HofError, InvalidKeys, RateLimited, Unauthenticated
from service.runtime.admission import Gate
from service.settings import Settings

MAX_DROPPED: Final = 65_536  # bytes of a refused request's body; to take those costs less than another connection

OPEN: Final = frozenset(
    {
        "/",
        "/docs",
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
    """The layer that turns away: 401 without a known key, 403 without its scope, 429 over the rate, and a photo
    while as many as may wait do. That here a refusal costs a third of what it does further in is what goodput
    under overload lives on.

    Without a keys file everyone may do everything, and rates are counted by client address. Sets
    ``scope["hof.key"]``, the key's name, and ``scope["hof.limited"]`` where the rate was exceeded.
    """

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self._app = app
        self._keys = keys_of(settings)
        self._metrics_need_a_key = settings.metrics == "key"
        self._rate = Rate(settings.rate_limit) if settings.rate_limit else None

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer it."""
        needed = self._needed(scope) if scope["type"] == "http" else None
        if needed is None:
            await self._app(scope, receive, send)
            return
        added: dict[str, str] = {}

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.update(added)
                if self._keys:
                    headers.add_vary_header(VARY)  # a shared cache must not give one client's answer to another
            await send(message)

        try:
            self._check_key(scope, needed)
            if self._rate and needed != "metrics":
                self._check_rate(self._rate, scope, added)
            if scope["hof.route"] == "/encode" and scope["method"] == "POST":
                _check_room(scope["app"])
        except HofError as error:
            response = respond(error)
            added |= _refusal_headers(error, scope, needed)
            await response(scope, receive, send_with_headers)
        else:
            await self._app(scope, receive, send_with_headers)

    def _needed(self, scope: Scope) -> str | None:
        """The scope of keys that a request needs; None where anyone may."""
        if scope["hof.route"] == "/metrics" and self._metrics_need_a_key:
            return "metrics"
        if scope["hof.route"] in OPEN:
            return None
        return "read" if scope["method"] in ("GET", "HEAD") else "write"

    def _check_key(self, scope: Scope, needed: str) -> None:
        """Raises Unauthenticated or Forbidden."""
        if self._keys is None:
            return
        token = _token(Headers(scope=scope))
        if token is None:
            raise Unauthenticated("this call needs an API key: `Authorization: Bearer KEY`, or `X-API-Key: KEY`")
        key = self._keys.find(token.encode("latin-1"))
        if key is None:
            raise Unauthenticated("this API key is not known")
        scope["hof.key"] = key.name
        if needed not in key.scopes:
            raise Forbidden(f"this call needs a key of the scope {needed}")

    def _check_rate(self, rate: "Rate", scope: Scope, headers: dict[str, str]) -> None:
        """Count the request and tell what is left. Raises RateLimited."""
        who = scope.get("hof.key") or (scope["client"] or ("",))[0]
        allowed = rate.hit(who)
        remaining, wait_s = rate.state(who)
        headers["RateLimit-Policy"] = f'"requests";q={rate.amount};w={rate.window_s}'
        headers["RateLimit"] = f'"requests";r={remaining};t={wait_s}'
        if not allowed:
            scope["hof.limited"] = True
            raise RateLimited(f"more than {rate.amount} requests in {rate.window_s} s", retry_after_s=wait_s)


class Rate:
    """How many requests each client may make in a sliding window, `100/minute` say; counted in this process."""

    def __init__(self, text: str) -> None:
        self._item: RateLimitItem = parse(text)
        self._limiter = SlidingWindowCounterRateLimiter(MemoryStorage())
        self.amount: Final = self._item.amount
        self.window_s: Final = self._item.get_expiry()

    def hit(self, who: str) -> bool:
        """Count a request, unless it exceeds the rate."""
        return self._limiter.hit(self._item, who)

    def state(self, who: str) -> tuple[int, int]:
        """How many requests are left, and in how many seconds there will be another."""
        reset_at, remaining = self._limiter.get_window_stats(self._item, who)
        return remaining, max(1, math.ceil(reset_at - time.time()))


def _check_room(app: FastAPI) -> None:
    """Raises Overloaded."""
    if app.state.runtime is not None:
        images: Gate = app.state.runtime.gates.images
        images.check()


def keys_of(settings: Settings) -> Keys | None:
    """The keys of the settings' file; None for no file. Raises InvalidKeys."""
    if settings.api_keys_file is not None:
        return Keys.read(settings.api_keys_file)
    if settings.metrics == "key":
        raise InvalidKeys("/metrics is to need a key, but there is no keys file: name one by --api-keys-file")
    return None


def _token(headers: Headers) -> str | None:
    scheme, _, token = headers.get("authorization", "").partition(" ")
    return token.strip() if scheme.lower() == "bearer" else headers.get("x-api-key")


def _refusal_headers(error: HofError, scope: Scope, needed: str) -> dict[str, str]:
    headers = {}
    if isinstance(error, Unauthenticated):
        headers["WWW-Authenticate"] = 'Bearer realm="hof"'
    elif isinstance(error, Forbidden):
        headers["WWW-Authenticate"] = f'Bearer realm="hof", error="insufficient_scope", scope="{needed}"'
    asked = Headers(scope=scope)
    declared = asked.get("content-length", "0")
    is_small = declared.isdecimal() and int(declared) <= MAX_DROPPED
    if "transfer-encoding" in asked or "expect" in asked or not is_small:
        headers["Connection"] = "close"  # the body stays unread
    return headers
