"""Security headers for browsers: those of every answer, and CORS."""

from collections.abc import Sequence
from typing import Final

from starlette.middleware.cors import CORSMiddleware
from starlette.types import ASGIApp, Message, Receive, Scope, Send

SECURE: Final = {
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",  # pages have policies of their own
    "Cross-Origin-Resource-Policy": "same-origin",  # where CORS is on, browsers use it instead
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}

_RAW: Final = tuple((name.lower().encode(), value.encode()) for name, value in SECURE.items())

REQUEST_HEADERS: Final = ("Authorization", "Content-Type", "If-None-Match", "X-API-Key", "X-Request-ID")
EXPOSED_HEADERS: Final = (
    "Content-Disposition",
    "ETag",
    "Location",
    "RateLimit",
    "RateLimit-Policy",
    "Retry-After",
    "X-Request-ID",
)


def with_cors(app: ASGIApp, origins: Sequence[str]) -> ASGIApp:
    """Return the app with CORS for these origins. It needs no cookies: their pages send API keys themselves."""
    return CORSMiddleware(
        app,
        allow_origins=origins,
        allow_methods=["GET", "HEAD", "POST", "PATCH", "DELETE"],
        allow_headers=REQUEST_HEADERS,
        expose_headers=EXPOSED_HEADERS,
    )


class SecurityHeaders:
    """Add the headers of `SECURE` that an answer does not set itself."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and add headers to its answer."""

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                fields = message["headers"]
                set_already = {name.lower() for name, _ in fields}
                message["headers"] = [*fields, *(field for field in _RAW if field[0] not in set_already)]
            await send(message)

        await self._app(scope, receive, send_with_headers)
