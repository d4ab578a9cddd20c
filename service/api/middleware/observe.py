"""Observation of every request: an id that its client gets back, metrics, and one line of the access log."""

import asyncio
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

from service.api.context import RequestContext, attach, refusal_of
from service.api.problems import respond
from service.errors import NotReady
from service.telemetry.logs import REQUEST_ID
from service.telemetry.metrics import Metrics

logger: Final = logging.getLogger("hof.access")

REQUEST_ID_HEADER: Final = "X-Request-ID"
SAFE_ID: Final = re.compile(r"[A-Za-z0-9._:-]{1,128}")  # nothing that could end a header or a line of the log
METHODS: Final = frozenset({"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"})
MAX_PATH: Final = 256  # characters of a path that are logged
CLIENT_LEFT: Final = 499  # not a status of HTTP, but nginx's, which dashboards know


class Templates:
    """Templates of a service's paths, for example `/objects/{id}`."""

    def __init__(self, templates: Iterable[str]) -> None:
        patterns = {template: compile_path(template) for template in templates}
        self._exact = {template for template, (_, _, convertors) in patterns.items() if not convertors}
        self._others = [(pattern, name) for name, (pattern, _, _) in patterns.items() if name not in self._exact]

    def of(self, path: str) -> str | None:
        """Return the template that matches a path; None for a path that the service does not have."""
        if path in self._exact:
            return path
        return next((name for pattern, name in self._others if pattern.fullmatch(path)), None)


class Observe:
    """The outermost layer: attach the request context, and record how each request ends.

    A client's `X-Request-ID` is kept if it is safe; every answer has one, that of a fault included.
    """

    def __init__(self, app: ASGIApp, metrics: Metrics, templates: Templates) -> None:
        self._app = app
        self._metrics = metrics
        self._templates = templates

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and record it when it has ended, with an answer or without."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        context = RequestContext(self._templates.of(scope["path"]), is_head=scope["method"] == "HEAD")
        attach(scope, context)
        exchange = Exchange(scope, receive, send)
        with self._metrics.in_flight.track_inprogress():
            try:
                await self._app(scope, exchange.receive, exchange.send)
            except asyncio.CancelledError:  # only a stop of the server cancels calls; it would log a fault
                if not exchange.has_begun:
                    await respond(NotReady("the service is stopping"))(scope, exchange.receive, exchange.send)
            finally:
                self._record(exchange, context)

    def _record(self, exchange: "Exchange", context: RequestContext) -> None:
        scope, status, seconds = exchange.scope, exchange.status, time.perf_counter() - exchange.began
        method = scope["method"] if scope["method"] in METHODS else "other"
        route = context.route or "unknown"
        self._metrics.requests.labels(method, route, status).inc()
        self._metrics.latency.labels(method, route).observe(seconds)
        if status == CLIENT_LEFT:
            self._metrics.count_unserved("cancelled")
        elif status == 429:
            self._metrics.count_unserved("limited" if context.is_rate_limited else "shed")
        elif status >= 500 and status != 503:  # 503: it starts or stops, or its database is out
            self._metrics.count_unserved("failed")
        if not logger.isEnabledFor(logging.INFO):
            return
        path = quote(scope["path"], safe="/{}:@!$&'()*+,;=~")[:MAX_PATH]  # quoted, so that it cannot forge a line
        fields: dict[str, Any] = {"method": scope["method"], "route": route, "path": path, "status": status}
        fields |= {"seconds": round(seconds, 6), "bytes": exchange.bytes, "client": (scope["client"] or [None])[0]}
        if context.key is not None:
            fields["key"] = context.key
        logger.info("%s %s %d %.1f ms", scope["method"], path, status, 1000 * seconds, extra={"fields": fields})


class Exchange:
    """A request and the progress of its answer.

    Attributes
    ----------
    began : time of the request, `time.perf_counter()`.
    bytes : bytes of the answer's body that were sent.
    """

    def __init__(self, scope: Scope, receive: Receive, send: Send) -> None:
        self.scope = scope
        self.began: Final = time.perf_counter()
        self.bytes = 0
        self._receive = receive
        self._send = send
        self._sent_status: int | None = None
        self._is_complete = False  # whether the answer was sent to its end
        self._client_left = False
        client_id = Headers(scope=scope).get(REQUEST_ID_HEADER, "")
        # Not secret, so not `uuid4`: that calls the kernel and releases the interpreter, which is costly under load.
        self._id = client_id if SAFE_ID.fullmatch(client_id) else f"{random.getrandbits(128):032x}"
        REQUEST_ID.set(self._id)

    @property
    def status(self) -> int:
        """Status of the answer; 499 if the client left before it was complete; 500 if it broke off otherwise."""
        if self._client_left:
            return refusal_of(self.scope) or CLIENT_LEFT
        return self._sent_status if self._is_complete and self._sent_status is not None else 500

    @property
    def has_begun(self) -> bool:
        """Return whether a part of the answer was sent."""
        return self._sent_status is not None

    async def receive(self) -> Message:
        """Return the next message of the request; a disconnect before the end of the answer is noted."""
        message = await self._receive()
        if message["type"] == "http.disconnect" and not self._is_complete:
            self._client_left = True
        return message

    async def send(self, message: Message) -> None:
        """Send a message of the answer, with the request's id, and count its bytes."""
        if message["type"] == "http.response.start":
            self._sent_status = message["status"]
            MutableHeaders(scope=message)[REQUEST_ID_HEADER] = self._id
        await self._send(message)
        if message["type"] == "http.response.body":
            self.bytes += 0 if self.scope["method"] == "HEAD" else len(message.get("body", b""))
            self._is_complete = not message.get("more_body", False)
