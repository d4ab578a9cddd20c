"""The server: uvicorn in one process, or several that share a port, and a stop that loses no call.

On SIGTERM uvicorn closes its socket at once, while load balancers still send: for them this one first answers
`/health/ready` with 503 and goes on serving. Then it takes the connections that the kernel has accepted, and no new
ones, and ends when the calls in progress have ended. SIGINT and a second SIGTERM skip the wait.
"""

import asyncio
import contextlib
import ctypes
import os
import signal
import socket
import struct
import sys
import time
from functools import partial
from types import FrameType
from typing import Final

import uvicorn
from uvicorn.config import STARTUP_FAILURE
from uvicorn.supervisors import multiprocess

from service.api import app
from service.api.middleware.access import keys_of
from service.encoding.matting import Matting
from service.encoding.registry import Models
from service.server.http_protocol import bounded_heads
from service.server.memory import keep_for_good, share_one_arena
from service.settings import Settings
from service.storage import database
from service.telemetry import logs
from service.telemetry.metrics import shared_by_workers

WORKER_START_S: Final = 60  # until a worker has imported all; one that takes longer is started anew, for ever

CLOSE: Final = (b"connection", b"close")
SETTLE_S: Final = 0.2  # from the last connection until its request has been read
SO_ATTACH_FILTER: Final = 26
RETURN: Final = 0x06  # the only instruction of a filter that keeps 0 bytes of any packet


def serve(settings: Settings) -> None:
    """Serve until a signal ends it. Exits with uvicorn's status where the port is taken, say.

    Raises
    ------
    InvalidModel, InvalidKeys, UnusableStore : what the service could not start with.
    """
    share_one_arena()
    _check(settings)
    config = Config(settings)
    if settings.workers > 1:
        with shared_by_workers():
            multiprocess.Multiprocess(config, [config.bind_socket()]).run()
        return
    server = Server(config)
    with contextlib.suppress(KeyboardInterrupt):
        server.run()
    if not server.started:
        sys.exit(STARTUP_FAILURE)


def _check(settings: Settings) -> None:
    """Open what the server will open, so that what is wrong with it ends here, in a sentence."""
    Models.open(settings.model, settings.threads)
    Matting.of(settings.matting_model, settings.threads)
    keys_of(settings)
    asyncio.run(database.check(settings.database_url))


class Config(uvicorn.Config):
    """What uvicorn is told, and how long to drain."""

    def __init__(self, settings: Settings) -> None:
        super().__init__(
            partial(app.create_app, settings),
            factory=True,
            host=settings.host,
            port=settings.port,
            workers=settings.workers,
            lifespan="on",
            http=bounded_heads(settings.client_timeout_s),
            ws="none",
            log_config=logs.configuration(settings.log_format, settings.log_level),
            access_log=False,  # service.api.middleware.observe has one
            timeout_worker_healthcheck=WORKER_START_S,
            timeout_graceful_shutdown=settings.shutdown_s,
        )
        self.drain_s: Final = settings.drain_s


class Server(uvicorn.Server):
    """One process's server. While it drains, ``request.state.draining`` is true and answers close their connection."""

    config: Config

    def __init__(self, config: Config) -> None:
        super().__init__(config)
        self._drained_at: float | None = None

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Open the models and the store, and listen; what that made is kept for good."""
        await super().startup(sockets)
        keep_for_good()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Take a signal: the first SIGTERM begins to drain, any other ends that."""
        if sig != signal.SIGTERM or not self.started or self._drained_at is not None:
            super().handle_exit(sig, frame)
            return
        self._drained_at = time.monotonic() + self.config.drain_s
        self.lifespan.state["draining"] = True
        self.config.encoded_headers.append(CLOSE)  # of which uvicorn makes the next default headers, within a second
        self.server_state.default_headers = [*self.server_state.default_headers, CLOSE]

    async def on_tick(self, counter: int) -> bool:
        """Whether to stop; asked ten times a second."""
        if self._drained_at is not None and time.monotonic() >= self._drained_at and not self.should_exit:
            super().handle_exit(signal.SIGTERM, None)
        return await super().on_tick(counter)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Take what is in the kernel's queue, then stop as uvicorn does. A socket that is shared stays as it is."""
        if sockets is None and sys.platform == "linux":
            for listener in [listener for server in self.servers for listener in server.sockets]:
                with socket.socket(fileno=os.dup(listener.fileno())) as own:
                    _drop_packets(own)
            await asyncio.sleep(SETTLE_S)
        await super().shutdown(sockets)


class Worker(multiprocess.Process):
    """One process of several, with our server in it: uvicorn has no setting for that."""

    config: Config

    @property
    def server(self) -> Server:
        """Made in the process itself."""
        if self._server is None:
            self._server = Server(self.config)
        assert isinstance(self._server, Server)  # noqa: S101 - for the type checker
        return self._server


multiprocess.Process = Worker  # type: ignore[misc]


def _drop_packets(listener: socket.socket) -> None:
    """Let a listening socket's queue only get shorter: clients that come later are refused once it is closed."""
    instruction = ctypes.create_string_buffer(struct.pack("HBBI", RETURN, 0, 0, 0))
    listener.setsockopt(socket.SOL_SOCKET, SO_ATTACH_FILTER, struct.pack("HP", 1, ctypes.addressof(instruction)))
