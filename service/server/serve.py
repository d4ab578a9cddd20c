"""`hof serve`: uvicorn in one process, or in several that share a port."""

import asyncio
import contextlib
import sys

from uvicorn.config import STARTUP_FAILURE

from service.api.middleware.access import keys_of
from service.encoding.matting import Matting
from service.encoding.registry import Models
from service.server.memory import share_one_arena
from service.server.process import Config, Server
from service.server.workers import Supervisor
from service.settings import Settings
from service.storage import database
from service.telemetry.metrics import shared_by_workers


def serve(settings: Settings) -> None:
    """Serve until a signal ends it. Exits with uvicorn's status if it cannot listen, for example on a port in use.

    Raises
    ------
    InvalidModel, InvalidKeys, UnusableStore : the service cannot start with these settings.
    """
    share_one_arena()
    _check(settings)
    config = Config(settings)
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
    """Open what the server will open, so that a wrong setting ends the command here, with one sentence."""
    Models.open(settings.model, settings.threads)
    Matting.of(settings.matting_model, settings.threads)
    keys_of(settings)
    asyncio.run(database.verify(settings.database_url, settings.database_timeout_s))
