"""A server byte for byte, past what a client of HTTP would send."""

import socket

from conftest import Server
from slow import DEADLINE_S


def connect(server: Server) -> socket.socket:
    return socket.create_connection(("127.0.0.1", server.port), timeout=DEADLINE_S)


def rest(connection: socket.socket) -> bytes:
    """All that the server sends until it closes."""
    return b"".join(iter(lambda: connection.recv(65_536), b""))
