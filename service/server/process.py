"""The server of one process: uvicorn, with a stop that loses no call.

On SIGTERM uvicorn closes its socket at once, while load balancers still send. This server first answers
`/health/ready` with 503 and goes on serving for `drain_s`. Then it accepts the connections that wait in the kernel,
closes the socket, and ends when the calls in progress have ended. SIGINT, or a second SIGTERM, skips the wait. One of
several workers that is replaced retires instead: it stays ready, and its calls may take as long as they need.
"""

import asyncio
import contextlib
import os
import signal
import socket
import sys
import time
from functools import partial
from types import FrameType
from typing import Final

import uvicorn

from service.api import app
from service.runtime.networks import Networks
from service.server.http_protocol import http_protocol
from service.server.memory import freeze_startup_objects, release_unused_memory
from service.settings import Settings
from service.telemetry import logs

WORKER_START_S: Final = 60  # a worker that takes longer to import and open everything is started again, without end
CLOSE: Final = (b"connection", b"close")
TURN_S: Final = 0.02  # after which Python's threads take turns, not 0.005: fewer turns, and more photos under overload
SETTLE_S: Final = 0.2  # from the last accepted connection until its request has been read


class Config(uvicorn.Config):
    """Uvicorn's configuration, made from our settings, and the seconds to drain.

    Parameters
    ----------
    networks : those of the settings, if they are open already; workers open their own.
    """

    def __init__(self, settings: Settings, networks: Networks | None = None) -> None:
        super().__init__(
            partial(app.create_app, settings, networks),
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
        self._retires = False

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Open the models and the store, listen, and exclude what exists by then from garbage collection."""
        sys.setswitchinterval(TURN_S)
        await super().startup(sockets)
        freeze_startup_objects()
        release_unused_memory()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Handle a signal: the first SIGTERM starts to drain, any other signal ends the server."""
        if not self.started:  # it may be waiting for its database, and has nothing to lose
            signal.signal(sig, signal.SIG_DFL)
            signal.raise_signal(sig)
        if sig != signal.SIGTERM or self._drained_at is not None:
            super().handle_exit(sig, frame)
            return
        self.lifespan.state["draining"] = True
        self._drain()

    def retire(self) -> None:
        """Leave new connections to the other workers, and end once no call is in progress."""
        if self._drained_at is None:
            self._retires = True
            self._drain()

    def _drain(self) -> None:
        self._drained_at = time.monotonic() + self.config.drain_s
        self.config.encoded_headers.append(CLOSE)  # uvicorn rebuilds its default headers from these every second
        self.server_state.default_headers = [*self.server_state.default_headers, CLOSE]

    async def on_tick(self, counter: int) -> bool:
        """Return whether to stop; uvicorn calls this ten times a second."""
        if self._retires:
            await self._accept_the_rest()
        is_drained = self._drained_at is not None and time.monotonic() >= self._drained_at
        if is_drained and not self.should_exit and not (self._retires and self.server_state.tasks):
            super().handle_exit(signal.SIGTERM, None)
        return await super().on_tick(counter)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Close the socket, read the requests of the connections accepted until then, and stop as uvicorn does.

        Uvicorn alone also closes connections whose request it has not read yet. `python -m benchmarks.load.run --parts
        faults` counts the calls that break.
        """
        await self._accept_the_rest()
        for listener in sockets or []:  # shared by workers: the last one to close it ends the queue
            listener.close()
        await asyncio.sleep(SETTLE_S)
        await super().shutdown(None)

    async def _accept_the_rest(self) -> None:
        """Close the listening sockets, and serve the connections that waited in the kernel until then."""
        loop = asyncio.get_running_loop()
        for connection in self._close_listeners():
            await loop.connect_accepted_socket(self._protocol, connection)

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
