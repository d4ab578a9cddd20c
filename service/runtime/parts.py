"""What every request needs and the application opens once: settings, models, store, worker threads."""

import asyncio
import math
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, ParamSpec, TypeVar

from fastapi import Depends
from starlette.requests import Request

from service.encoding.encoder import Encoder
from service.encoding.matting import Matting
from service.encoding.registry import Models
from service.errors import NotReady
from service.runtime.admission import Gates
from service.runtime.batcher import Batcher
from service.runtime.liveness import Vital
from service.settings import Settings
from service.storage.store import Store
from service.telemetry.metrics import Metrics

P = ParamSpec("P")
R = TypeVar("R")


@dataclass(frozen=True)
class Runtime:
    """The opened parts of a running service; `matting` is None where no such model is set.

    Attributes
    ----------
    gates : what bounds the work that is let in.
    batchers : by the models' names, each encoder, shared by those who wait for it.
    vitals : the parts that a ready service needs, by the words for it.
    """

    settings: Settings
    models: Models
    matting: Matting | None
    store: Store
    executor: Executor
    metrics: Metrics

    @cached_property
    def gates(self) -> Gates:  # noqa: D102
        return Gates.of(self.settings)

    @cached_property
    def batchers(self) -> dict[str, Batcher]:  # noqa: D102
        return {encoder.name: Batcher(encoder.encode, self.run) for encoder in self.models}

    @cached_property
    def vitals(self) -> dict[str, Vital]:  # noqa: D102
        encoders = {f"model {encoder.name}": self._vital(encoder) for encoder in self.models}
        return {**encoders, "store": Vital(self.store.ping, lambda: -math.inf)}

    def _vital(self, encoder: Encoder) -> Vital:
        batcher, blank = self.batchers[encoder.name], encoder.blank()
        return Vital(lambda: batcher.encode(blank), lambda: batcher.answered_at)

    async def run(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Call a function that computes on a worker thread, off the event loop.

        Cancelled before a thread takes it, it never runs; after that, the cancellation waits for its end.
        """
        job = self.executor.submit(self.metrics.timed(function), *args, **kwargs)
        ended = asyncio.wrap_future(job)
        try:
            return await asyncio.shield(ended)
        except asyncio.CancelledError:
            if not job.cancel():
                await asyncio.wait((ended,))
                ended.exception()  # nobody else will ask for it
            raise


async def runtime(request: Request) -> Runtime:  # async: FastAPI would call it on a thread otherwise
    """The service's parts. Raises NotReady before they are opened and after they are closed."""
    parts: Runtime | None = request.app.state.runtime
    if parts is None:
        raise NotReady("the service is starting or stopping")
    return parts


Ready = Annotated[Runtime, Depends(runtime)]
