"""The opened parts of a running service: settings, models, store, worker threads, gates."""

import asyncio
import threading
from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import cached_property, partial
from typing import ParamSpec, TypeVar

from service.encoding.encoder import Encoder
from service.encoding.matting import Matting
from service.encoding.registry import Models
from service.runtime.admission import Gates
from service.runtime.batcher import Batcher
from service.runtime.inputs.photos import RecentPhotos
from service.runtime.liveness import LivenessProbe
from service.settings import Settings
from service.storage.store import Store
from service.telemetry.metrics import Metrics

P = ParamSpec("P")
R = TypeVar("R")


@dataclass(frozen=True)
class Runtime:
    """The opened parts of a running service; `matting` is None if no matting model is set.

    Attributes
    ----------
    gates : the bounds on the work that is admitted.
    batchers : the encoder of each model, shared by concurrent requests; by the models' names.
    probes : liveness of the parts that a ready service needs; by the parts' names in error messages.
    """

    settings: Settings
    models: Models
    matting: Matting | None
    store: Store
    executor: Executor
    metrics: Metrics
    gates: Gates

    @cached_property
    def batchers(self) -> dict[str, Batcher]:  # noqa: D102
        return {
            encoder.name: Batcher(encoder.encode, self._run_if_due, self.settings.threads) for encoder in self.models
        }

    @cached_property
    def recent_photos(self) -> RecentPhotos:
        """Objects of photos that this process has encoded or found lately."""
        return RecentPhotos()

    @cached_property
    def probes(self) -> dict[str, LivenessProbe]:  # noqa: D102
        encoders = {f"model {encoder.name}": self._encoder_probe(encoder) for encoder in self.models}
        store = LivenessProbe(
            self.store.ping, lambda: self.store.answered_at, fresh_s=0, max_silence_s=self.store.max_silence_s
        )
        return {**encoders, "store": store}

    def _encoder_probe(self, encoder: Encoder) -> LivenessProbe:
        batcher, blank = self.batchers[encoder.name], encoder.blank()
        return LivenessProbe(lambda: batcher.encode(blank), lambda: batcher.answered_at)

    async def run(self, function: Callable[P, R], *args: P.args, **kwargs: P.kwargs) -> R:
        """Call a function on a worker thread, off the event loop, and return its result.

        If canceled before a thread takes it, it never runs; after that, the cancellation waits until it has ended.
        """
        return await self._run(partial(function, *args, **kwargs), lambda: None)

    async def run_stoppable(self, function: Callable[[threading.Event], R]) -> R:
        """Call a function as `run` does, with an event that is set if the call is canceled: the function should end."""
        stop = threading.Event()
        return await self._run(partial(function, stop), stop.set)

    async def _run_if_due(self, function: Callable[[], R | None]) -> R | None:
        """Call a function as `run` does; one that returns None has given up its turn, and is not counted as work."""
        return await self._run(function, lambda: None, is_work=lambda result: result is not None)

    async def _run(
        self,
        function: Callable[[], R],
        on_cancel: Callable[[], None],
        is_work: Callable[[R], bool] = lambda _result: True,
    ) -> R:
        job = self.executor.submit(self.metrics.timed(function, is_work))
        ended = asyncio.wrap_future(job)
        try:
            return await asyncio.shield(ended)
        except asyncio.CancelledError:
            on_cancel()
            if not job.cancel():
                await asyncio.wait((ended,))
                ended.exception()  # retrieved here, because nobody else will
            raise
