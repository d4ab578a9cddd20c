"""A server that answers each connection with prepared bytes and then closes it, as faulty servers and proxies do."""

import contextlib
import socket
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field


@dataclass
class Scripted:
    """A running server.

    url : its base URL.
    requests : the heads of the requests so far.
    """

    url: str
    requests: list[bytes] = field(default_factory=list)


@contextlib.contextmanager
def scripted(*answers: bytes | None) -> Iterator[Scripted]:
    """Run a server that gives one connection after the other its answer; it refuses those after the last.

    For None it says nothing until the client leaves.
    """
    with socket.create_server(("127.0.0.1", 0)) as listener:
        server = Scripted(f"http://127.0.0.1:{listener.getsockname()[1]}")

        def serve() -> None:
            for answer in answers:
                connection, _ = listener.accept()
                with connection:
                    head = b""
                    while b"\r\n\r\n" not in head:
                        head += connection.recv(65536)
                    server.requests.append(head)
                    if answer is not None:
                        connection.sendall(answer)
                        connection.shutdown(socket.SHUT_WR)
                    while connection.recv(65536):
                        pass

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield server
        thread.join(timeout=10)
        assert not thread.is_alive(), f"only {len(server.requests)} of {len(answers)} connections came"


def answer(status: str, body: bytes = b"", *, length: int | None = None, **headers: str) -> bytes:
    """Return an answer of HTTP/1.1. `length` is the one that it claims; names of headers have _ for -."""
    fields = {"Content-Length": str(len(body) if length is None else length), "Connection": "close"} | headers
    lines = "".join(f"{name.replace('_', '-')}: {value}\r\n" for name, value in fields.items())
    return f"HTTP/1.1 {status}\r\n{lines}\r\n".encode() + body
