"""Headers that tell browsers what they may do with an answer: those that every answer has, and CORS."""

from collections.abc import Sequence
from typing import Final

from starlette.middleware.cors import CORSMiddleware
from starlette.types import ASGIApp, Message, Receive, Scope, Send

SECURE: Final = {
    "Content-Security-Policy": "default-src 'none'; frame-ancestors 'none'",  # pages have policies of their own
    "Cross-Origin-Resource-Policy": "same-origin",  # CORS, where it is on, is asked instead
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}

RAW: Final = tuple((name.lower().encode(), value.encode()) for name, value in SECURE.items())

ASKED: Final = ("Authorization", "Content-Type", "If-None-Match", "X-API-Key", "X-Request-ID")
SHOWN: Final = (
    "Content-Disposition",
    "ETag",
    "Location",
    "RateLimit",
    "RateLimit-Policy",
    "Retry-After",
    "X-Request-ID",
)


def with_cors(app: ASGIApp, origins: Sequence[str]) -> ASGIApp:
    """The service, also for pages of these origins, which send their keys themselves: no cookies are involved."""
    return CORSMiddleware(
        app,
        allow_origins=origins,
        allow_methods=["GET", "HEAD", "POST", "DELETE"],
        allow_headers=ASKED,
        expose_headers=SHOWN,
    )


class SecureHeaders:
    """Adds those of `SECURE` that an answer does not set itself."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on."""

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                fields = message["headers"]
                set_already = {name.lower() for name, _ in fields}
                message["headers"] = [*fields, *(field for field in RAW if field[0] not in set_already)]
            await send(message)

        await self._app(scope, receive, send_with_headers)
