"""Protection from other sites' pages, for a service without API keys, which anyone who reaches it may call.

A page of another site runs in the browser of someone who does reach it. It could post a form, or point a name of its
own at this machine (DNS rebinding). With API keys it could do neither, because it has no key.
"""

import ipaddress
import re
import socket
from typing import Final

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Receive, Scope, Send

from service.api.context import context_of
from service.api.problems import respond
from service.errors import Forbidden, HofError, Misdirected
from service.settings import Settings

PROBES: Final = frozenset({"/health/live", "/health/ready", "/v2/health/live", "/v2/health/ready"})
SAFE_METHODS: Final = frozenset({"GET", "HEAD", "OPTIONS"})
PRIVATE_SUFFIXES: Final = (".localhost", ".local", ".internal", ".svc", ".home.arpa")  # nobody can register these
PORT: Final = re.compile(r":[0-9]*$")


class RefuseForeignPages:
    """Refuse requests that another site's page makes a browser send: 421 by its Host, 403 by its origin.

    Parameters
    ----------
    settings : `allowed_hosts` are names that are accepted besides addresses, names without a dot and private names;
        `cors_origins` may call from other sites.
    """

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self._app = app
        names = settings.allowed_hosts.lower().split(",") if settings.allowed_hosts else []
        self._hosts = {*names, settings.host.lower(), socket.gethostname().lower()}
        self._origins = set(settings.cors_origins.lower().split(",")) if settings.cors_origins else set()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or answer it."""
        if scope["type"] == "http":
            headers = Headers(scope=scope)
            try:
                if context_of(scope).route not in PROBES:
                    self._check_host(headers)
                if scope["method"] not in SAFE_METHODS:
                    self._check_origin(headers)
            except HofError as error:
                response = respond(error)
                response.headers["Connection"] = "close"  # the body stays unread
                await response(scope, receive, send)
                return
        await self._app(scope, receive, send)

    def _check_host(self, headers: Headers) -> None:
        """Raise Misdirected for a host name that a stranger could have registered. Without Host it is no browser."""
        host = PORT.sub("", headers.get("host", "localhost")).lower().removesuffix(".")
        is_allowed = host in self._hosts or "*" in self._hosts or "." not in host
        if not (is_allowed or host.endswith(PRIVATE_SUFFIXES) or _is_address(host)):  # the last is the slowest
            raise Misdirected(
                f"this service has no API keys and does not answer for the host {host[:253]}; allow that name with "
                "--allowed-hosts (HOF_ALLOWED_HOSTS)"
            )

    def _check_origin(self, headers: Headers) -> None:
        """Raise Forbidden for a request of another site's page, by what browsers send and pages cannot change."""
        site, origin = headers.get("sec-fetch-site"), headers.get("origin")
        if "*" in self._origins or (origin is not None and origin.lower() in self._origins):
            return
        if site is None:
            is_own = origin is None or origin.lower().partition("://")[2] == headers.get("host", "").lower()
        else:
            is_own = site in ("same-origin", "none")
        if not is_own:
            raise Forbidden(
                f"the page of another origin ({(origin or 'unknown')[:253]}) may not change this service; allow the "
                "origin with --cors-origins (HOF_CORS_ORIGINS)"
            )


def _is_address(host: str) -> bool:
    try:
        ipaddress.ip_address(host.removeprefix("[").removesuffix("]"))
    except ValueError:
        return False
    return True
