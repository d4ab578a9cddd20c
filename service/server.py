"""`hof serve`: one process, or several that share a port, each a whole service of its own."""

import asyncio
from functools import partial
from typing import Any, Final

import uvicorn
from uvicorn.supervisors import Multiprocess

from service import app, logs
from service.access import keys_of
from service.encoder import Encoder
from service.matting import Matting
from service.metrics import shared_by_workers
from service.settings import Settings
from service.store import Store

WORKER_START_S: Final = 60  # until a worker has imported all; one that takes longer is started anew, for ever


def serve(settings: Settings) -> None:
    """Serve until a signal ends it.

    Raises
    ------
    InvalidModel, InvalidKeys, UnusableStore : what the service could not start with.
    """
    _check(settings)
    options: dict[str, Any] = {
        "factory": True,
        "host": settings.host,
        "port": settings.port,
        "workers": settings.workers,
        "lifespan": "on",
        "ws": "none",
        "log_config": logs.configuration(settings.log_format, settings.log_level),
        "timeout_worker_healthcheck": WORKER_START_S,
        "access_log": False,  # service.observing has one
    }
    application = partial(app.create_app, settings)
    if settings.workers == 1:
        uvicorn.run(application, **options)
        return
    with shared_by_workers():
        config = uvicorn.Config(application, **options)
        Multiprocess(config, [config.bind_socket()]).run()


def _check(settings: Settings) -> None:
    """Open what the server will open, so that what is wrong with it ends here, in a sentence."""
    Encoder.open(settings.model, settings.threads)
    Matting.of(settings.matting_model, settings.threads)
    keys_of(settings)
    asyncio.run(_check_store(settings.database_url))


async def _check_store(url: str) -> None:
    store = await Store.open(url)
    await store.close()
