"""What the service tells of each request: an id that its client gets back, figures, and one line of the log."""

import logging
import random
import re
import time
from collections.abc import Iterable
from typing import Any, Final
from urllib.parse import quote

from starlette.datastructures import Headers, MutableHeaders
from starlette.routing import compile_path
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.telemetry.logs import REQUEST_ID
from service.telemetry.metrics import Metrics

logger: Final = logging.getLogger("hof.access")

REQUEST_ID_HEADER: Final = "X-Request-ID"
SANE_ID: Final = re.compile(r"[A-Za-z0-9._:-]{1,128}")  # nothing that could end a header or a line of the log
METHODS: Final = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
MAX_PATH: Final = 256  # characters of a path that are logged
CLIENT_LEFT: Final = 499  # no status of HTTP: nginx's, which dashboards know


class Templates:
    """Which of a service's paths, `/objects/{id}` say, a request's path is."""

    def __init__(self, templates: Iterable[str]) -> None:
        patterns = {template: compile_path(template) for template in templates}
        self._exact = {template for template, (_, _, convertors) in patterns.items() if not convertors}
        self._others = [(pattern, name) for name, (pattern, _, _) in patterns.items() if name not in self._exact]

    def of(self, path: str) -> str | None:
        """The template; None for a path that the service does not have."""
        if path in self._exact:
            return path
        return next((name for pattern, name in self._others if pattern.fullmatch(path)), None)


class Observed:
    """The outermost layer: ``scope["hof.route"]`` tells the others the path's template.

    A client's `X-Request-ID` is kept if it is sane; every answer has one, also that of a fault.
    """

    def __init__(self, app: ASGIApp, metrics: Metrics, templates: Templates) -> None:
        self._app = app
        self._metrics = metrics
        self._templates = templates

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and tell of it when it has ended, however it does."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        scope["hof.route"] = self._templates.of(scope["path"])
        exchange = Exchange(scope, receive, send)
        with self._metrics.in_flight.track_inprogress():
            try:
                await self._app(scope, exchange.receive, exchange.send)
            finally:
                self._tell(exchange)

    def _tell(self, exchange: "Exchange") -> None:
        scope, status, seconds = exchange.scope, exchange.status, time.perf_counter() - exchange.began
        method = scope["method"] if scope["method"] in METHODS else "other"
        route = scope["hof.route"] or "unknown"
        self._metrics.requests.labels(method, route, status).inc()
        self._metrics.latency.labels(method, route).observe(seconds)
        if status == CLIENT_LEFT:
            self._metrics.count_unserved("cancelled")
        elif status == 429:
            self._metrics.count_unserved("limited" if "hof.limited" in scope else "shed")
        elif status >= 500 and status != 503:  # 503: starting or stopping, which is no fault
            self._metrics.count_unserved("failed")
        if not logger.isEnabledFor(logging.INFO):
            return
        path = quote(scope["path"], safe="/{}:@!$&'()*+,;=~")[:MAX_PATH]  # what is odd in it cannot forge a line
        fields: dict[str, Any] = {"method": scope["method"], "route": route, "path": path, "status": status}
        fields |= {"seconds": round(seconds, 6), "bytes": exchange.bytes, "client": (scope["client"] or [None])[0]}
        if "hof.key" in scope:
            fields["key"] = scope["hof.key"]
        logger.info("%s %s %d %.1f ms", scope["method"], path, status, 1000 * seconds, extra={"fields": fields})


class Exchange:
    """A request and what has become of it.

    Attributes
    ----------
    bytes : of the answer's body, as far as it was sent.
    """

    def __init__(self, scope: Scope, receive: Receive, send: Send) -> None:
        self.scope = scope
        self.began: Final = time.perf_counter()
        self.bytes = 0
        self._receive = receive
        self._send = send
        self._answered: int | None = None  # the status, once it was sent
        self._ended = False  # whether the answer was sent to its end
        self._client_left = False
        asked = Headers(scope=scope).get(REQUEST_ID_HEADER, "")
        # No secret: `uuid4` asks the kernel, and gives up the interpreter for it, which costs most under load.
        self._id = asked if SANE_ID.fullmatch(asked) else f"{random.getrandbits(128):032x}"
        REQUEST_ID.set(self._id)

    @property
    def status(self) -> int:
        """The answer's status; where it broke off, 499 if the client left and else 500, whatever it began with."""
        if self._ended and self._answered is not None:
            return self._answered
        return CLIENT_LEFT if self._client_left else 500

    async def receive(self) -> Message:
        """As ASGI's; notes whether the client left before it was answered."""
        message = await self._receive()
        if message["type"] == "http.disconnect" and not self._ended:
            self._client_left = True
        return message

    async def send(self, message: Message) -> None:
        """As ASGI's; adds the request's id and counts."""
        if message["type"] == "http.response.start":
            self._answered = message["status"]
            MutableHeaders(scope=message)[REQUEST_ID_HEADER] = self._id
        await self._send(message)
        if message["type"] == "http.response.body":
            self.bytes += 0 if self.scope["method"] == "HEAD" else len(message.get("body", b""))
            self._ended = not message.get("more_body", False)
