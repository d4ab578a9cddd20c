"""HTTP/1.1 connections with limits on heads and framing: uvicorn alone reads any amount and waits without end.

`service.api.wire.uploads` limits bodies, and `service.api.wire.disconnects` watches for clients that leave.
"""

import asyncio
import logging
from functools import partial
from typing import Any, Final, NoReturn, cast

import httptools
from starlette.datastructures import MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from uvicorn.protocols.http.httptools_impl import STATUS_LINE, RequestResponseCycle

from service.api.context import note_refusal
from service.api.middleware.security_headers import SECURE
from service.api.problems import respond
from service.errors import HeadTooLarge, HofError, InvalidInput, Stalled
from service.server.http_head import check_framing, check_host, check_version, combine, without_upgrade
from service.server.lingering import LingeringTransport, close_later, droppable
from service.server.unread_answers import UnreadAnswerTimeout

logger: Final = logging.getLogger("hof.access")

MAX_HEAD_BYTES: Final = 65_536  # of a request's target and header fields
PUNCTUATION: Final = 4  # bytes of a field besides name and value: a colon, a space, CR and LF
MIN_CHUNK_BYTES: Final = 256  # average of a chunked body: the event loop spends as much on a chunk as on many bytes
FREE_CHUNKS: Final = 256  # that may be smaller
MAX_FRAMING_BYTES: Final = 16_384  # chunk sizes and extensions, besides an eighth of the body


def http_protocol(client_timeout_s: float) -> type[asyncio.Protocol]:
    """Return the protocol factory for uvicorn's setting `http`.

    A client has `client_timeout_s` seconds to send a whole head, and as long to take the next bytes of an answer.
    """
    factory = partial(LimitedHttpProtocol, client_timeout_s=client_timeout_s)  # a partial can be pickled
    return cast(type[asyncio.Protocol], factory)


class LimitedHttpProtocol(UnreadAnswerTimeout):
    """One connection. Too large a head is a 431, too slow a head a 408, and anything but HTTP a 400.

    Each of these is a problem document and ends the connection. A client that connects and sends nothing is
    disconnected without an answer.

    Heads follow the rules of `service.server.http_head`. Trailers are dropped. A wish to change the protocol is
    ignored, that of `curl --http2` for example. A body in many tiny chunks, or in chunks with long extensions, is a
    400.

    One request at a time: bytes that arrive before the answer has ended are dropped, and the connection ends with
    that answer (RFC 9112, 9.3.2: the client then sends the request again). So no queue grows, and a client that
    leaves is always noticed.
    """

    def __init__(self, *args: Any, client_timeout_s: float, **options: Any) -> None:  # noqa: ANN401 - as uvicorn calls it
        super().__init__(*args, unread_timeout_s=client_timeout_s, **options)
        self._client_timeout_s = client_timeout_s
        self._timer: asyncio.TimerHandle | None = None  # runs until the head is complete
        self._head_has_begun = False  # the head that the timer waits for has a first byte
        self._head_bytes = 0  # of this request, trailers included
        self._ignores_input = False  # the connection is about to end
        self._droppable = 0  # bytes that are dropped until then
        self._lingers_until: float | None = None  # loop time at which an answered connection ends
        self._held_bytes = 0  # received, but not yet part of a target, field or body: httptools buffers a field
        self._error: HofError | None = None  # ended the parsing
        self._is_upgrade = False  # the head asks for another protocol: it is parsed again without that
        self._is_in_body = False  # the head is complete
        self._body_bytes = self._wire_bytes = self._chunks = 0  # of this body; wire: with its framing, without trailers

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for the first head."""
        super().connection_made(transport)
        self._start_timer()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop waiting."""
        self._stop_timer()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Parse the data. Refuse a single field that is larger than a whole head may be."""
        if self._ignores_input:
            self._drop(len(data))
            return
        self._held_bytes += len(data)
        self._wire_bytes += len(data) if self._is_in_body else 0
        self._unset_keepalive_if_required()
        self._parse(data)
        if self._ignores_input or self.transport.is_closing():
            return
        if self._held_bytes > MAX_HEAD_BYTES:
            self._refuse(_too_large())
        elif self._is_in_body and self._wire_bytes > MAX_FRAMING_BYTES + self._body_bytes * 9 // 8:
            self._refuse(InvalidInput("the body has more framing than content: send chunks without extensions"))
        elif self._timer is None and self.cycle is not None and self.cycle.response_complete:
            # The answer is out, and the rest of an unread body or blank lines arrive: uvicorn would wait without end.
            self._lingers_until = self._lingers_until or self.loop.time() + self.timeout_keep_alive
            self.timeout_keep_alive_task = self.loop.call_at(self._lingers_until, self.timeout_keep_alive_handler)

    def on_message_begin(self) -> None:
        """Begin a head. Raises InvalidInput, which ends the parsing, while the previous request is being answered."""
        if self.cycle is not None and not self.cycle.response_complete:
            self.cycle.keep_alive = False
            self._ignores_input = True
            raise InvalidInput("one request at a time")
        super().on_message_begin()
        self._lingers_until = None
        self._error = None
        self._is_upgrade = self._is_in_body = False
        self._body_bytes = self._wire_bytes = self._chunks = 0
        self._head_bytes = self._held_bytes = 0
        self._head_has_begun = True
        if self._timer is None:
            self._start_timer()

    def on_url(self, url: bytes) -> None:
        """Take a part of the target. Raises HeadTooLarge, which ends the parsing."""
        self._count(len(url))
        super().on_url(url)

    def on_header(self, name: bytes, value: bytes) -> None:
        """Take a field of the head, drop one of the trailers. Raises HeadTooLarge, which ends the parsing."""
        self._count(len(name) + len(value) + PUNCTUATION)
        if self._is_in_body:
            self._wire_bytes -= len(name) + len(value) + PUNCTUATION  # trailers have a limit of their own
        else:
            super().on_header(name, value)

    def on_headers_complete(self) -> None:
        """End the head. Raises InvalidInput or UnsupportedVersion, which ends the parsing."""
        version, method = self.parser.get_http_version(), self.parser.get_method()
        try:
            check_version(version, method)
            check_framing(version, self.headers)
            check_host(version, self.url, self.headers)
        except HofError as error:
            self._fail(error)
        if self.parser.should_upgrade():
            self._is_upgrade = True  # `_parse` continues
            return
        combine(self.headers)
        self._stop_timer()
        self._is_in_body = True
        super().on_headers_complete()

    def on_chunk_header(self) -> None:
        """Begin a chunk. Raises InvalidInput, which ends the parsing, if a body has too many small ones."""
        self._chunks += 1
        if self._chunks > FREE_CHUNKS + self._body_bytes // MIN_CHUNK_BYTES:
            self._fail(InvalidInput(f"the chunks of the body have fewer than {MIN_CHUNK_BYTES} bytes on average"))

    def on_body(self, body: bytes) -> None:
        """Take a part of the body."""
        self._held_bytes = 0
        self._body_bytes += len(body)
        super().on_body(body)

    def on_message_complete(self) -> None:
        """End the request."""
        self._is_in_body = False
        if not self._is_upgrade:
            super().on_message_complete()

    def send_400_response(self, msg: str) -> None:
        """Answer a parsing error, ours or httptools' (400)."""
        if not self._ignores_input:
            self._refuse(self._error or InvalidInput(msg))

    def _start_asgi_task(self, cycle: RequestResponseCycle, app: ASGIApp) -> None:  # type: ignore[override]
        cycle.transport = cast(asyncio.Transport, LingeringTransport(self.transport, self._end))
        if cycle.scope["http_version"] == "1.0":
            cycle.waiting_for_100_continue = False
            app = partial(_without_chunks, app, cycle)
        super()._start_asgi_task(cycle, app)  # type: ignore[arg-type]

    def _end(self) -> None:
        """Close the connection after its last answer; later if the client still sends."""
        if self._is_in_body:
            self._ignores_input = True
            self._droppable = droppable(self.headers)
            self.flow.resume_reading()
            close_later(self.transport)
        else:
            self.transport.close()

    def _drop(self, size: int) -> None:
        """Count bytes that nobody reads; an answered connection ends when there are too many."""
        self._droppable -= size
        if self._droppable < 0 and self.cycle is not None and self.cycle.response_complete:
            self.transport.close()

    def _parse(self, data: bytes) -> None:
        """Parse the data. A head that asks for another protocol is parsed again without that, before its body."""
        try:
            self.parser.feed_data(data)
        except httptools.HttpParserUpgrade as upgrade:
            head = without_upgrade(self.parser.get_method(), self.url, self.parser.get_http_version(), self.headers)
            self.parser = httptools.HttpRequestParser(self)
            self.parser.set_dangerous_leniencies(lenient_data_after_close=True)  # as uvicorn does
            self._parse(head + data[upgrade.args[0] :])
        except httptools.HttpParserError:
            self.send_400_response("the bytes received are not an HTTP request")

    def _fail(self, error: HofError) -> NoReturn:
        """End the parsing with an error."""
        self._error = error
        raise error

    def _count(self, size: int) -> None:
        self._held_bytes = 0
        self._head_bytes += size
        if self._head_bytes > MAX_HEAD_BYTES:
            self._fail(_too_large())

    def _start_timer(self) -> None:
        self._timer = self.loop.call_later(self._client_timeout_s, self._time_out)

    def _stop_timer(self) -> None:
        self._head_has_begun = False
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _time_out(self) -> None:
        if self._head_has_begun:
            self._refuse(Stalled(f"the request's head was not complete within {self._client_timeout_s:g} s"))
        else:
            self.transport.close()

    def _refuse(self, error: HofError) -> None:
        """Log the error, send it unless another answer has begun, and end the connection. No route sees the call."""
        fields = {"status": error.status, "client": self.client[0] if self.client else None}
        logger.info("no request: %d %s", error.status, error.title, extra={"fields": fields})
        cycle = self.cycle
        is_in_request = cycle is not None and not cycle.response_complete  # a part of a request has arrived
        if not is_in_request or (cycle.more_body and not cycle.response_started):
            answer = respond(error)
            headers = MutableHeaders(raw=[*self.server_state.default_headers, *answer.raw_headers])
            headers.update({**SECURE, "Connection": "close"})
            lines = b"".join(b"%b: %b\r\n" % field for field in headers.raw)
            self.transport.write(STATUS_LINE[error.status] + lines + b"\r\n" + bytes(answer.body))
            if is_in_request:
                note_refusal(cast(Scope, cycle.scope), error.status)
        if is_in_request:
            cycle.disconnected = True  # so that the call sends nothing more, and ends
            cycle.message_event.set()
        self.transport.close()
        self.abort_if_unread()


def _too_large() -> HeadTooLarge:
    return HeadTooLarge(f"the request's head has more than {MAX_HEAD_BYTES} bytes, the limit")


async def _without_chunks(
    app: ASGIApp, cycle: RequestResponseCycle, scope: Scope, receive: Receive, send: Send
) -> None:
    """Answer HTTP/1.0, which has no chunks: the end of the connection ends a body without a Content-Length."""
    ends_with_connection = False

    async def send_unchunked(message: Message) -> None:
        nonlocal ends_with_connection
        if message["type"] == "http.response.start":
            ends_with_connection = all(name.lower() != b"content-length" for name, _ in message.get("headers", []))
            if ends_with_connection:
                cycle.chunked_encoding = False
        elif ends_with_connection:
            cycle.expected_content_length = len(message.get("body", b""))  # uvicorn compares each message with it
        await send(message)

    await app(scope, receive, send_unchunked)
