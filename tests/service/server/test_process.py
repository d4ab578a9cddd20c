"""The stop of one process: every connection that was taken is answered."""

import asyncio
import socket
from collections.abc import Callable

import pytest
import uvloop

from service.server.process import Config, Server
from service.settings import Settings
from tests.support.raw_sockets import rest

LINE = b"GET /health/live HTTP/1.1\r\nHost: x\r\n\r\n"
COUNT = 20


@pytest.mark.parametrize("new_loop", [asyncio.new_event_loop, uvloop.new_event_loop], ids=["asyncio", "uvloop"])
def test_shutdown_with_connections_not_yet_read_answers_them(
    new_loop: Callable[[], asyncio.AbstractEventLoop], settings: Settings
) -> None:
    async def scenario() -> list[bytes]:
        server = Server(Config(settings.model_copy(update={"port": 0})))
        serving = asyncio.create_task(server.serve())
        while not server.started:
            await asyncio.sleep(0.01)
        address = server.servers[0].sockets[0].getsockname()
        clients = [socket.create_connection(address, timeout=60) for _ in range(COUNT)]  # the loop accepts none of them
        for client in clients[::2]:
            client.sendall(LINE)
        answers = [asyncio.create_task(asyncio.to_thread(rest, client)) for client in clients]
        shutdown = asyncio.create_task(server.shutdown())
        await asyncio.sleep(0)  # one turn of the loop: from here on nobody connects whose request would not be read
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(address, timeout=60)
        while len(server.server_state.connections) < COUNT:
            await asyncio.sleep(0)
        for client in clients[1:-1:2]:
            client.sendall(LINE)
        await shutdown
        server.should_exit = True
        await serving
        try:
            return await asyncio.gather(*answers)
        finally:
            for client in clients:
                client.close()

    with asyncio.Runner(loop_factory=new_loop) as runner:
        answers = runner.run(scenario())
    assert [answer[:12] for answer in answers] == [b"HTTP/1.1 200"] * (COUNT - 1) + [b""]  # the last one sent nothing
