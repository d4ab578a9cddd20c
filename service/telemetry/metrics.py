"""Metrics for Prometheus. Labels hold route templates, never ids, so that the number of series stays small.

Each application has its own registry. With several worker processes, prometheus_client keeps the values in files of
the folder `PROMETHEUS_MULTIPROC_DIR`, and the worker that answers /metrics adds up those of all workers.
"""

import os
import platform
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Literal, ParamSpec, TypeVar

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector
from prometheus_client.exposition import choose_encoder
from prometheus_client.multiprocess import MultiProcessCollector, mark_process_dead

from service import __version__

P = ParamSpec("P")
R = TypeVar("R")
Reason = Literal["shed", "limited", "cancelled", "failed"]

FOLDER: Final = "PROMETHEUS_MULTIPROC_DIR"
SECONDS: Final = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30, 60)


class Metrics:
    """The counters and histograms of one process; `requests` and `latency` are labeled by route template."""

    def __init__(self) -> None:
        self._shared = FOLDER in os.environ
        self._registry = CollectorRegistry()
        own = self._registry
        self.requests: Final = Counter(
            "hof_http_requests",
            "Answered requests; status 499: the client left before the end",
            ["method", "route", "status"],
            registry=own,
        )
        self.latency: Final = Histogram(
            "hof_http_request_seconds",
            "Seconds from a request's headers to the last byte of its answer",
            ["method", "route"],
            buckets=SECONDS,
            registry=own,
        )
        self.in_flight: Final = Gauge(
            "hof_http_requests_in_flight", "Requests being answered", multiprocess_mode="livesum", registry=own
        )
        self.queue: Final = Histogram(
            "hof_queue_seconds", "Seconds that a computation waited for a worker thread", buckets=SECONDS, registry=own
        )
        self.compute: Final = Histogram(
            "hof_compute_seconds", "Seconds that a computation took on its worker thread", buckets=SECONDS, registry=own
        )
        self._unserved = Counter(
            "hof_http_unserved",
            "Requests that were not served: shed under load, limited by rate, cancelled by the client, failed by an "
            "error of the service",
            ["reason"],
            registry=own,
        )
        reasons: tuple[Reason, ...] = ("shed", "limited", "cancelled", "failed")
        for reason in reasons:
            self._unserved.labels(reason)  # exported as 0 from the start
        build = Gauge("hof_build_info", "1", ["version", "python"], multiprocess_mode="max", registry=own)
        build.labels(__version__, platform.python_version()).set(1)
        if not self._shared:
            ProcessCollector(registry=own)

    def count_unserved(self, reason: Reason) -> None:
        """Count a request that was not served."""
        self._unserved.labels(reason).inc()

    def timed(self, function: Callable[P, R]) -> Callable[P, R]:
        """Wrap a function for a worker thread to record its wait, from now on, and its duration."""
        submitted = time.perf_counter()

        def run(*args: P.args, **kwargs: P.kwargs) -> R:
            start = time.perf_counter()
            self.queue.observe(start - submitted)
            try:
                return function(*args, **kwargs)
            finally:
                self.compute.observe(time.perf_counter() - start)

        return run

    def exposition(self, accept: str) -> tuple[bytes, str]:
        """Return all metrics as text and their media type, Prometheus's or OpenMetrics, as `accept` prefers."""
        encode, media_type = choose_encoder(accept)
        return encode(_sum_of_workers() if self._shared else self._registry), media_type


@contextmanager
def shared_by_workers() -> Iterator[None]:
    """Let the processes that start within the block keep their metrics where each can read those of all."""
    with tempfile.TemporaryDirectory(prefix="hof-metrics-") as folder:
        os.environ[FOLDER] = folder
        try:
            yield
        finally:
            del os.environ[FOLDER]


def _sum_of_workers() -> CollectorRegistry:
    """Return a registry with the sums over all workers, without the requests in flight of ended workers."""
    folder = os.environ[FOLDER]
    for file in Path(folder).glob("gauge_live*_*.db"):
        pid = int(file.stem.rpartition("_")[2])
        if not _is_alive(pid):
            mark_process_dead(pid, folder)  # type: ignore[no-untyped-call]
    registry = CollectorRegistry()
    MultiProcessCollector(registry, folder)  # type: ignore[no-untyped-call]
    return registry


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
