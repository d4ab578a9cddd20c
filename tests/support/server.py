"""Run the service, or any handler of HTTP requests, in a thread of the tests; the type of what opens clients."""

import asyncio
import contextlib
import socket
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Protocol

import httpx
import uvicorn

from hof_client import Client, Retry
from service.api.app import create_app
from service.server.http_protocol import http_protocol
from service.settings import Settings


class Server(uvicorn.Server):
    """A server that tells its port, and that ends at once: uvicorn's checks only every 0.1 s whether to end."""

    async def main_loop(self) -> None:
        """Serve until `should_exit`."""
        while not await self.on_tick(0):
            await asyncio.sleep(0.01)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Close the connections, complete what is being answered, and close the service."""
        for server in self.servers:
            server.close()
        for connection in [*self.server_state.connections]:
            connection.shutdown()
        await asyncio.sleep(0)
        await self._wait_tasks_to_complete()
        await self.lifespan.shutdown()

    @property
    def port(self) -> int:
        """The port that the server listens on."""
        port: int = self.servers[0].sockets[0].getsockname()[1]
        return port


class Open(Protocol):
    """Open a client of a service, which is closed after the test."""

    def __call__(
        self, url: str, *, api_key: str | None = None, retry: Retry | None = None, timeout_s: float = 60
    ) -> Client: ...


@contextlib.contextmanager
def running(settings: Settings) -> Iterator[Server]:
    """Run the service in a thread, over a real socket, until the block ends."""
    http = http_protocol(settings.client_timeout_s)
    app = create_app(settings)
    config = uvicorn.Config(app, port=0, http=http, log_level="warning", lifespan="on", ws="none", proxy_headers=False)
    server = Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started and thread.is_alive():
        time.sleep(0.005)
    assert server.started
    try:
        yield server
    finally:
        server.should_exit = True
        thread.join()


@contextlib.contextmanager
def answering(handler: Callable[..., BaseHTTPRequestHandler]) -> Iterator[str]:
    """Let a handler answer requests, in threads, until the block ends; yield its URL."""
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_port}"
        finally:
            server.shutdown()
            thread.join()


def check_refused(answer: httpx.Response, field: str, limit: str) -> None:
    """Check that an answer is a 422 about one parameter, which names it and its limit."""
    assert answer.status_code == 422
    (error,) = answer.json()["errors"]
    assert error["field"] == field
    assert limit in error["message"]
