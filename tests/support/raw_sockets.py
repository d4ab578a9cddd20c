"""Connections to a server byte by byte, for requests that no HTTP client would send."""

import select
import socket
from http.client import HTTPResponse
from typing import NamedTuple

import httpx

from tests.support.server import Server
from tests.support.slow import DEADLINE_S

PAUSE_S = 0.05
PIECE, PIECE_S = 16_384, 0.002


def connect(server: Server) -> socket.socket:
    """Open a connection to a server."""
    return socket.create_connection(("127.0.0.1", server.port), timeout=DEADLINE_S)


def rest(connection: socket.socket) -> bytes:
    """Return all bytes that the server sends until it closes."""
    return b"".join(iter(lambda: connection.recv(65_536), b""))


def next_status(connection: socket.socket) -> int:
    """Read the next answer to its end, which may come in parts, and return its status."""
    answer = HTTPResponse(connection)
    answer.begin()
    answer.read()
    return answer.status


class Answer(NamedTuple):
    """An answer, read to its end."""

    status: int
    headers: dict[str, str]  # names in lower case
    body: bytes


def connect_to(url: str, source: str = "127.0.0.1") -> socket.socket:
    """Connect to a server from an address of the loopback network, which Linux has many of."""
    address = httpx.URL(url)
    return socket.create_connection((address.host, address.port or 80), DEADLINE_S, source_address=(source, 0))


def next_answer(connection: socket.socket) -> Answer:
    """Read the next answer to its end."""
    response = HTTPResponse(connection)
    response.begin()
    return Answer(response.status, {name.lower(): value for name, value in response.getheaders()}, response.read())


def ask(url: str, *parts: bytes, source: str = "127.0.0.1") -> Answer:
    """Send a request, each part when the server has had time to read the one before, and return its answer.

    An answer ends the sending, because what the server does not read any more would reset the connection.
    """
    with connect_to(url, source) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for index, part in enumerate(parts):
            wait_s = PAUSE_S if index else 0
            for begin in range(0, len(part), PIECE):
                if select.select([connection], [], [], wait_s)[0]:
                    return next_answer(connection)
                connection.sendall(part[begin : begin + PIECE])
                wait_s = PIECE_S
        return next_answer(connection)
