"""Connections to a server byte by byte, for requests that no HTTP client would send."""

import socket
from http.client import HTTPResponse

from tests.support.server import Server
from tests.support.slow import DEADLINE_S


def connect(server: Server) -> socket.socket:
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
