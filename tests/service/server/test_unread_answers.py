"""Answers that nobody reads end, and free what they held."""

import socket

import httpx
import pytest

from service.settings import Settings
from tests.support.server import running
from tests.support.slow import DEADLINE_S, runtime_of, until


@pytest.mark.parametrize("connection", ["keep-alive", "close"])
@pytest.mark.parametrize("target", ["mesh?resolution=160&format=obj", "points?n=10000000&format=f32"])
def test_answer_that_nobody_reads_ends_the_connection(
    settings: Settings, photo: bytes, target: str, connection: str
) -> None:
    with running(settings.model_copy(update={"client_timeout_s": 0.3})) as server:
        gates, connections = runtime_of(server).gates, server.server_state.connections
        with httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=DEADLINE_S) as client:
            path = client.post("/encode", content=photo).json()["links"]["self"]
        until(lambda: not connections)
        with socket.create_connection(("127.0.0.1", server.port), timeout=DEADLINE_S) as unread:
            request = f"GET {path}/{target} HTTP/1.1\r\nHost: x\r\nConnection: {connection}\r\n\r\n"
            unread.sendall(request.encode())
            until(lambda: gates.points.cancelled == 1)
            until(lambda: not connections)
            assert (gates.points.held, gates.answers.held) == (0, 0)
