"""Answers that a client does not take: after a timeout the connection is aborted, and what it held is freed."""

import asyncio
from collections.abc import Callable
from typing import Any, Final

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from service.api.middleware.slow_clients import MIN_RATE


class ReaderTimer:
    """Limit on the time that the bytes of an answer wait for their client.

    A client is too slow if it does not take the bytes that wait within `seconds`, or if it takes them at less than
    `MIN_RATE` after the first `seconds`, on average over an answer. Time in which no bytes wait does not count: the
    service computes them.

    Parameters
    ----------
    seconds : the limit.
    end : called once if the client is too slow.
    """

    def __init__(self, seconds: float, end: Callable[[], None]) -> None:
        self._seconds = seconds
        self._end = end
        self._timer: asyncio.TimerHandle | None = None
        self._began, self._waiting = 0.0, 0  # loop time at which the wait began, and bytes that waited then
        self._waited_s, self._taken = 0.0, 0  # of this answer: time of all waits, and bytes taken in them

    def begin_answer(self) -> None:
        """Forget the answer before."""
        self._waited_s, self._taken = 0.0, 0

    def start(self, waiting: int) -> None:
        """Begin a wait, unless one has begun; `waiting` bytes are there to be taken."""
        if self._timer is None:
            loop = asyncio.get_running_loop()
            self._began, self._waiting = loop.time(), waiting
            left_s = self._seconds + self._taken / MIN_RATE - self._waited_s
            self._timer = loop.call_later(min(self._seconds, left_s), self._end)

    def stop(self, waiting: int) -> None:
        """End the wait, if there is one; `waiting` bytes are left."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
            self._waited_s += asyncio.get_running_loop().time() - self._began
            self._taken += self._waiting - waiting


class UnreadAnswerTimeout(HttpToolsProtocol):
    """A connection that is aborted if its client does not take what is sent, or takes it too slowly: `ReaderTimer`.

    uvicorn waits for such a client without end: while it sends, and after it has closed, until all bytes are out.
    For the application, an aborted connection is a client that has left.
    """

    def __init__(self, *args: Any, unread_timeout_s: float, **options: Any) -> None:  # noqa: ANN401 - as uvicorn calls
        super().__init__(*args, **options)
        self._reader_timer: Final = ReaderTimer(unread_timeout_s, self._abort)

    def on_message_begin(self) -> None:
        """Begin a request, and with it another answer."""
        super().on_message_begin()
        self._reader_timer.begin_answer()

    def pause_writing(self) -> None:
        """Start the timer: more bytes wait for the client than the server sends ahead."""
        super().pause_writing()
        self._reader_timer.start(self.transport.get_write_buffer_size())

    def resume_writing(self) -> None:
        """Stop the timer."""
        self._reader_timer.stop(self.transport.get_write_buffer_size())
        super().resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the timer."""
        self._reader_timer.stop(0)
        super().connection_lost(exc)

    def on_response_complete(self) -> None:
        """Start the timer if this was the last answer, and its end is not out."""
        super().on_response_complete()
        self.abort_if_unread()

    def timeout_keep_alive_handler(self) -> None:
        """Start the timer if the end of the last answer is not out."""
        super().timeout_keep_alive_handler()
        self.abort_if_unread()

    def abort_if_unread(self) -> None:
        """Start the timer if the connection is closing, and bytes still wait for the client."""
        if self.transport.is_closing() and self.transport.get_write_buffer_size():
            self._reader_timer.start(self.transport.get_write_buffer_size())

    def _abort(self) -> None:
        self.transport.abort()
