"""What every request needs and the application opens once: settings, models, store, worker threads."""

import asyncio
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Annotated, ParamSpec, TypeVar

from fastapi import Depends
from starlette.requests import Request

from service.errors import NotReady
from service.matting import Matting
from service.models import Models
from service.settings import Settings
from service.store import Store

P = ParamSpec("P")
R = TypeVar("R")


@dataclass(frozen=True)
class Runtime:
    """The opened parts of a running service; `matting` is None where no such model is set."""

    settings: Settings
    models: Models
    matting: Matting | None
    store: Store
    executor: Executor

    async def run(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Call a function that computes on a worker thread, off the event loop."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self.executor, lambda: function(*args, **kwargs))


def runtime(request: Request) -> Runtime:
    """The service's parts. Raises NotReady before they are opened and after they are closed."""
    parts: Runtime | None = request.app.state.runtime
    if parts is None:
        raise NotReady("the service is starting or stopping")
    return parts


Ready = Annotated[Runtime, Depends(runtime)]
