"""Request heads, bounded in bytes and in time: uvicorn reads one of any size and waits for it for ever.

A body's bytes and times are bounded where it is read (`service.api.wire.uploads`, `service.api.wire.disconnects`).
"""

import asyncio
import logging
from functools import partial
from typing import Any, Final, cast

from starlette.datastructures import MutableHeaders
from uvicorn.protocols.http.httptools_impl import STATUS_LINE, HttpToolsProtocol

from service.api.middleware.security_headers import SECURE
from service.api.problems import respond
from service.errors import HeadTooLarge, HofError, InvalidInput, Stalled

logger: Final = logging.getLogger("hof.access")

MAX_HEAD_BYTES: Final = 65_536  # of a request's target and of its fields
PUNCTUATION: Final = 4  # bytes of a field beside its name and value: a colon, a space, the line's end


def bounded_heads(seconds: float) -> type[asyncio.Protocol]:
    """What uvicorn makes for each connection (its setting `http`): a head must be there after so many seconds."""
    return cast(type[asyncio.Protocol], partial(BoundedHeads, seconds=seconds))  # a partial can be pickled


class BoundedHeads(HttpToolsProtocol):
    """One connection. A head that is too large is a 431, one that does not end in time a 408, what is no HTTP a 400;
    each is a problem and the connection's end. A client that connects and says nothing is closed without a word.

    One request at a time: what comes before the answer has ended is dropped, and the connection ends with that
    answer (RFC 9112, 9.3.2: its client asks again). So no queue grows, and a client that leaves is always noticed.
    """

    def __init__(self, *args: Any, seconds: float, **options: Any) -> None:  # noqa: ANN401 - as uvicorn calls it
        super().__init__(*args, **options)
        self._seconds = seconds
        self._clock: asyncio.TimerHandle | None = None  # runs until the head has ended
        self._begun = False  # whether the clock's head has a first byte
        self._head_bytes = 0  # of this request; trailers count, too
        self._deaf = False  # what comes is dropped: the connection is about to end
        self._lingers_until: float | None = None  # the loop's time at which an answered connection ends
        self._held_bytes = 0  # received, and of no target, field or body so far: httptools collects a field

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for the first head."""
        super().connection_made(transport)
        self._start_clock()

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait no more."""
        self._stop_clock()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Read on, unless this is one field without an end."""
        if self._deaf:
            return
        self._held_bytes += len(data)
        super().data_received(data)
        if self._deaf or self.transport.is_closing():
            return
        if self._held_bytes > MAX_HEAD_BYTES:
            self._refuse(_too_large())
        elif self._clock is None and self.cycle is not None and self.cycle.response_complete:
            # The rest of a body that nobody reads, blank lines: uvicorn would not wait for their end, but for ever.
            self._lingers_until = self._lingers_until or self.loop.time() + self.timeout_keep_alive
            self.timeout_keep_alive_task = self.loop.call_at(self._lingers_until, self.timeout_keep_alive_handler)

    def on_message_begin(self) -> None:
        """The first byte of a head. Raises InvalidInput, which ends the parsing, where the last call still runs."""
        if self.cycle is not None and not self.cycle.response_complete:
            self.cycle.keep_alive = False
            self._deaf = True
            raise InvalidInput("one request at a time")
        super().on_message_begin()
        self._lingers_until = None
        self._head_bytes = self._held_bytes = 0
        self._begun = True
        if self._clock is None:
            self._start_clock()

    def on_url(self, url: bytes) -> None:
        """A part of the target. Raises HeadTooLarge, which ends the parsing."""
        self._count(len(url))
        super().on_url(url)

    def on_header(self, name: bytes, value: bytes) -> None:
        """A field of the head, or of the trailers. Raises HeadTooLarge, which ends the parsing."""
        self._count(len(name) + len(value) + PUNCTUATION)
        super().on_header(name, value)

    def on_headers_complete(self) -> None:
        """The head has ended."""
        self._stop_clock()
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        """A part of the body."""
        self._held_bytes = 0
        super().on_body(body)

    def send_400_response(self, msg: str) -> None:
        """What the parser refuses, or we within it."""
        if not self._deaf:
            self._refuse(_too_large() if self._head_bytes > MAX_HEAD_BYTES else InvalidInput("this is no HTTP request"))

    def _count(self, size: int) -> None:
        self._held_bytes = 0
        self._head_bytes += size
        if self._head_bytes > MAX_HEAD_BYTES:
            raise _too_large()

    def _start_clock(self) -> None:
        self._clock = self.loop.call_later(self._seconds, self._run_out)

    def _stop_clock(self) -> None:
        self._begun = False
        if self._clock is not None:
            self._clock.cancel()
            self._clock = None

    def _run_out(self) -> None:
        if self._begun:
            self._refuse(Stalled(f"the request's head did not end within {self._seconds:g} s"))
        else:
            self.transport.close()

    def _refuse(self, error: HofError) -> None:
        """Answer, unless that would break into another answer, and hang up. The log is told; no route is."""
        fields = {"status": error.status, "client": self.client[0] if self.client else None}
        logger.info("no request: %d %s", error.status, error.title, extra={"fields": fields})
        cycle = self.cycle
        is_within = cycle is not None and not cycle.response_complete  # a request of which a part has come
        if not is_within or (cycle.more_body and not cycle.response_started):
            answer = respond(error)
            headers = MutableHeaders(raw=[*self.server_state.default_headers, *answer.raw_headers])
            headers.update({**SECURE, "Connection": "close"})
            lines = b"".join(b"%b: %b\r\n" % field for field in headers.raw)
            self.transport.write(STATUS_LINE[error.status] + lines + b"\r\n" + bytes(answer.body))
        if is_within:
            cycle.disconnected = True  # so that the call says nothing more, and ends
            cycle.message_event.set()
        self.transport.close()


def _too_large() -> HeadTooLarge:
    return HeadTooLarge(f"the request's head has more than {MAX_HEAD_BYTES} bytes, the limit")
