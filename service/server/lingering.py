"""Connections that end while their client still sends: the client can read the answer before they close.

The kernel resets a connection that closes with unread bytes, and the client may lose the answer by that
(RFC 9112, 9.6). So the server says that it sends nothing more, drops what arrives, and closes later.
"""

import asyncio
from collections.abc import Callable, Iterable
from typing import Final

LINGER_S: Final = 2.0  # for which a client may go on sending
MAX_DECLARED: Final = 64 * 2**20  # bytes that are dropped of a body that says its length
MAX_CHUNKED: Final = 2**20  # bytes that are dropped of a body that may have no end


class LingeringTransport:
    """The part of a transport that an answer needs; `close` is replaced.

    Parameters
    ----------
    transport : the connection.
    close : called in place of the transport's own.
    """

    def __init__(self, transport: asyncio.Transport, close: Callable[[], None]) -> None:
        self.write: Final = transport.write
        self.is_closing: Final = transport.is_closing
        self.close: Final = close


def droppable(headers: Iterable[tuple[bytes, bytes]]) -> int:
    """Return how many bytes of a request's body may be dropped after its answer."""
    length = dict(headers).get(b"content-length", b"")
    return min(int(length), MAX_DECLARED) if length.isdigit() else MAX_CHUNKED


def close_later(transport: asyncio.Transport) -> None:
    """Say that nothing more is sent, and close after `LINGER_S`. The caller drops what arrives.

    A connection that cannot end in one direction alone closes at once.
    """
    if not transport.can_write_eof():
        transport.close()
        return
    transport.write_eof()
    asyncio.get_running_loop().call_later(LINGER_S, transport.close)
