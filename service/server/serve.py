"""`hof serve`: uvicorn in one process, or in several that share a port."""

import asyncio
import contextlib
import logging
import sys
from collections.abc import Iterator
from typing import Final

from uvicorn.config import STARTUP_FAILURE

from service.api.middleware.access import keys_of
from service.api.routes.viewer import BUNDLE, NOT_BUILT
from service.encoding import compiled as pixels
from service.mapping import compiled
from service.runtime.networks import Networks
from service.server.memory import release_unused_memory, share_one_arena
from service.server.process import Config, Server
from service.server.workers import Supervisor
from service.settings import Settings
from service.storage import database
from service.telemetry.metrics import shared_by_workers

logger: Final = logging.getLogger("hof")
NO_MATTING: Final = (
    "matting is off (--matting-model none): photos need transparency or a plain background, else the whole picture "
    "counts as the object"
)


def serve(settings: Settings) -> None:
    """Serve until a signal ends it. Exits with uvicorn's status if it cannot listen, for example on a port in use.

    Raises
    ------
    InvalidModel, InvalidKeys, UnusableStore : the service cannot start with these settings.
    """
    share_one_arena()
    networks: Networks | None = Networks.open(settings)
    _check(settings)
    if settings.workers > 1:
        networks = None  # each worker opens its own
        release_unused_memory()
    config = Config(settings, networks)  # configures the log
    for message in _missing_parts(settings):
        logger.info(message)
    if settings.workers > 1:
        with shared_by_workers():
            Supervisor(config, [config.bind_socket()]).run()
        return
    server = Server(config)
    with contextlib.suppress(KeyboardInterrupt):
        server.run()
    if not server.started:
        sys.exit(STARTUP_FAILURE)


def _check(settings: Settings) -> None:
    """Open what else the server will open, so that a wrong setting ends the command here, with one sentence."""
    keys_of(settings)
    asyncio.run(database.verify(settings.database_url, settings.database_timeout_s))


def _missing_parts(settings: Settings) -> Iterator[str]:
    """Yield what the service runs without, and how to add it."""
    if settings.matting_model is None:
        yield NO_MATTING
    if not BUNDLE.is_dir():
        yield f"/ and /docs are missing: {NOT_BUILT}"
    if compiled.load() is None:
        yield compiled.NOT_BUILT
    elif pixels.load() is None:
        yield pixels.NOT_BUILT
