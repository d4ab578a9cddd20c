"""A server byte for byte, past what a client of HTTP would send."""

import socket
from http.client import HTTPResponse

from tests.support.server import Server
from tests.support.slow import DEADLINE_S


def connect(server: Server) -> socket.socket:
    return socket.create_connection(("127.0.0.1", server.port), timeout=DEADLINE_S)


def rest(connection: socket.socket) -> bytes:
    """All that the server sends until it closes."""
    return b"".join(iter(lambda: connection.recv(65_536), b""))


def next_status(connection: socket.socket) -> int:
    """That of the next answer, which is read to its end: head and body may come apart."""
    answer = HTTPResponse(connection)
    answer.begin()
    answer.read()
    return answer.status
