"""The server of one process: uvicorn, with a stop that loses no call.

On SIGTERM uvicorn closes its socket at once, while load balancers still send. This server first answers
`/health/ready` with 503 and goes on serving for `drain_s`. Then it accepts the connections that wait in the kernel,
closes the socket, and ends when the calls in progress have ended. SIGINT, or a second SIGTERM, skips the wait.
"""

import asyncio
import contextlib
import os
import signal
import socket
import time
from functools import partial
from types import FrameType
from typing import Final

import uvicorn

from service.api import app
from service.server.http_protocol import http_protocol
from service.server.memory import freeze_startup_objects
from service.settings import Settings
from service.telemetry import logs

WORKER_START_S: Final = 60  # a worker that takes longer to import and open everything is started again, without end
CLOSE: Final = (b"connection", b"close")
SETTLE_S: Final = 0.2  # from the last accepted connection until its request has been read


class Config(uvicorn.Config):
    """Uvicorn's configuration, made from our settings, and the seconds to drain."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(
            partial(app.create_app, settings),
            factory=True,
            host=settings.host,
            port=settings.port,
            workers=settings.workers,
            lifespan="on",
            http=http_protocol(settings.client_timeout_s),
            ws="none",
            log_config=logs.configuration(settings.log_format, settings.log_level),
            proxy_headers=settings.trusted_proxies is not None,  # else uvicorn believes everyone on this machine
            forwarded_allow_ips=settings.trusted_proxies,
            access_log=False,  # service.api.middleware.observe writes one
            timeout_worker_healthcheck=WORKER_START_S,
            timeout_graceful_shutdown=settings.shutdown_s,
        )
        self.drain_s: Final = settings.drain_s


class Server(uvicorn.Server):
    """The server of one process. While it drains, ``request.state.draining`` is true and answers end connections."""

    config: Config

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self._drained_at: float | None = None  # time.monotonic() at which draining ends

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Open the models and the store, listen, and exclude what exists by then from garbage collection."""
        await super().startup(sockets)
        freeze_startup_objects()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Handle a signal: the first SIGTERM starts to drain, any other signal ends the server."""
        if sig != signal.SIGTERM or not self.started or self._drained_at is not None:
            super().handle_exit(sig, frame)
            return
        self._drained_at = time.monotonic() + self.config.drain_s
        self.lifespan.state["draining"] = True
        self.config.encoded_headers.append(CLOSE)  # uvicorn rebuilds its default headers from these every second
        self.server_state.default_headers = [*self.server_state.default_headers, CLOSE]

    async def on_tick(self, counter: int) -> bool:
        """Return whether to stop; uvicorn calls this ten times a second."""
        if self._drained_at is not None and time.monotonic() >= self._drained_at and not self.should_exit:
            super().handle_exit(signal.SIGTERM, None)
        return await super().on_tick(counter)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Close the socket, read the requests of the connections accepted until then, and stop as uvicorn does.

        Uvicorn alone also closes connections whose request it has not read yet. `python -m benchmarks.load.run --parts
        faults` counts the calls that break. A socket that workers share is not emptied: the other workers serve it.
        """
        if sockets is None:
            loop = asyncio.get_running_loop()
            for connection in self._close_listeners():
                await loop.connect_accepted_socket(self._protocol, connection)
            await asyncio.sleep(SETTLE_S)
        await super().shutdown(sockets)

    def _close_listeners(self) -> list[socket.socket]:
        """Close the listening sockets; return the connections that waited in the kernel until then."""
        connections = []
        for server in self.servers:
            for listener in server.sockets:
                with socket.socket(fileno=os.dup(listener.fileno())) as own, contextlib.suppress(BlockingIOError):
                    own.setblocking(False)
                    while True:
                        connections.append(own.accept()[0])
            server.close()
        return connections

    def _protocol(self) -> asyncio.Protocol:
        """Create the protocol of a connection, as uvicorn's `startup` does."""
        protocol: asyncio.Protocol = self.config.http_protocol_class(  # type: ignore[call-arg]
            config=self.config, server_state=self.server_state, app_state=self.lifespan.state
        )
        return protocol
