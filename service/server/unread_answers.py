"""Answers that a client does not take: after a timeout the connection is aborted, and what it held is freed."""

import asyncio
from typing import Any, Final

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol


class UnreadAnswerTimeout(HttpToolsProtocol):
    """A connection that is aborted if its client does not take what is sent.

    uvicorn waits for such a client without end: while it sends, and after it has closed, until all bytes are out.
    """

    def __init__(self, *args: Any, unread_timeout_s: float, **options: Any) -> None:  # noqa: ANN401 - as uvicorn calls
        super().__init__(*args, **options)
        self._unread_timeout_s: Final = unread_timeout_s
        self._abort_timer: asyncio.TimerHandle | None = None

    def pause_writing(self) -> None:
        """Start the timeout: more bytes wait for the client than the server sends ahead."""
        super().pause_writing()
        self._start_abort_timer()

    def resume_writing(self) -> None:
        """Stop the timeout."""
        self._stop_abort_timer()
        super().resume_writing()

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop the timeout."""
        self._stop_abort_timer()
        super().connection_lost(exc)

    def on_response_complete(self) -> None:
        """Start the timeout if this was the last answer, and its end is not out."""
        super().on_response_complete()
        self.abort_if_unread()

    def timeout_keep_alive_handler(self) -> None:
        """Start the timeout if the end of the last answer is not out."""
        super().timeout_keep_alive_handler()
        self.abort_if_unread()

    def abort_if_unread(self) -> None:
        """Start the timeout if the connection is closing, and bytes still wait for the client."""
        if self.transport.is_closing() and self.transport.get_write_buffer_size():
            self._start_abort_timer()

    def _start_abort_timer(self) -> None:
        if self._abort_timer is None:
            self._abort_timer = self.loop.call_later(self._unread_timeout_s, self.transport.abort)

    def _stop_abort_timer(self) -> None:
        if self._abort_timer is not None:
            self._abort_timer.cancel()
            self._abort_timer = None
