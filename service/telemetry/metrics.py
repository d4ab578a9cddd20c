"""Metrics for Prometheus. Labels hold route templates, never ids, so that the number of series stays small.

Each application has its own registry. With several worker processes, prometheus_client keeps the values in files of
the folder `PROMETHEUS_MULTIPROC_DIR`, and the worker that answers /metrics adds up those of all workers.
"""

import contextlib
import math
import os
import platform
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final, Literal, TypeVar, get_args

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, ProcessCollector, values
from prometheus_client.exposition import choose_encoder
from prometheus_client.multiprocess import MultiProcessCollector, mark_process_dead

from service import __version__

R = TypeVar("R")
Reason = Literal["shed", "limited", "cancelled", "failed"]

FOLDER: Final = "PROMETHEUS_MULTIPROC_DIR"
CHECK_S: Final = 1.0  # between two looks at the folder
MARKER: Final = "gauge_livesum"  # the file that each worker creates first, for `in_flight`
DELETED: Final = " (deleted)"  # after the name of such a file in /proc
SECONDS: Final = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30, 60)


class Metrics:
    """The counters and histograms of one process; `requests` and `latency` are labeled by route template."""

    def __init__(self) -> None:
        self._files = WorkerFiles(Path(os.environ[FOLDER])) if FOLDER in os.environ else None
        if self._files:
            values.ValueClass = values.MultiProcessValue(self._files.name)  # type: ignore[no-untyped-call]
        self._registry = own = CollectorRegistry()
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
            "error of the service; a 503, while it starts or stops or its database is out, counts in none",
            ["reason"],
            registry=own,
        )
        for reason in get_args(Reason):
            self._unserved.labels(reason)  # exported as 0 from the start
        build = Gauge("hof_build_info", "1", ["version", "python"], multiprocess_mode="max", registry=own)
        build.labels(__version__, platform.python_version()).set(1)
        if not self._files:
            ProcessCollector(registry=own)

    def count_unserved(self, reason: Reason) -> None:
        """Count a request that was not served."""
        self._unserved.labels(reason).inc()

    def timed(self, function: Callable[[], R], is_work: Callable[[R], bool]) -> Callable[[], R]:
        """Wrap a function for a worker thread to record its wait, from now on, and its duration, if it did work."""
        submitted = time.perf_counter()

        def record(start: float) -> None:
            self.queue.observe(start - submitted)
            self.compute.observe(time.perf_counter() - start)

        def run() -> R:
            start = time.perf_counter()
            try:
                result = function()
            except BaseException:
                record(start)
                raise
            if is_work(result):
                record(start)
            return result

        return run

    def exposition(self, accept: str) -> tuple[bytes, str]:
        """Return all metrics as text and their media type, Prometheus's or OpenMetrics, as `accept` prefers."""
        encode, media_type = choose_encoder(accept)
        if not self._files:
            return encode(self._registry), media_type
        self._files.check_now()
        self.in_flight.inc(0)  # looks for the folder
        return encode(_sum_of_workers(self._files.folder)), media_type


class WorkerFiles:
    """The names of a worker's files of metrics, which end with its pid.

    Programs that tidy /tmp delete the folder in the end. Then the worker writes its numbers to new files in a new one.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._generation = 0
        self._checked_at = -math.inf

    def check_now(self) -> None:
        """Let the next call of `name` look for the folder."""
        self._checked_at = -math.inf

    def name(self) -> str:
        """Return the last part of the names. prometheus_client asks for it before each change, and alone."""
        now = time.monotonic()
        if now - self._checked_at > CHECK_S:
            self._checked_at = now
            if not (self.folder / f"{MARKER}_{self._name}.db").exists():
                self._restore()
        return self._name

    @property
    def _name(self) -> str:
        return f"{os.getpid()}-{self._generation}"

    def _restore(self) -> None:
        """Copy this worker's deleted files to files of new names."""
        self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        files = _deleted_files(self.folder)
        self._generation += 1
        for name, content in files.items():
            kind = name.rpartition("_")[0]
            (self.folder / f"{kind}_{self._name}.db").write_bytes(content)


def _deleted_files(folder: Path) -> dict[str, bytes]:
    """Return the files of a folder that this process has open although they were deleted; Linux."""
    files = {}
    for descriptor in Path("/proc/self/fd").glob("*"):
        with contextlib.suppress(OSError):
            target = os.readlink(descriptor)
            if target.endswith(f".db{DELETED}") and target.startswith(f"{folder}/"):
                files[Path(target.removesuffix(DELETED)).name] = descriptor.read_bytes()
    return files


@contextmanager
def shared_by_workers() -> Iterator[None]:
    """Let the processes that start within the block keep their metrics where each can read those of all."""
    with tempfile.TemporaryDirectory(prefix="hof-metrics-") as folder:
        os.environ[FOLDER] = folder
        try:
            yield
        finally:
            del os.environ[FOLDER]


def _sum_of_workers(folder: Path) -> CollectorRegistry:
    """Return a registry with the sums over all workers, without the requests in flight of ended workers."""
    for file in folder.glob("gauge_live*_*.db"):
        name = file.stem.rpartition("_")[2]
        if not _is_alive(int(name.partition("-")[0])):
            mark_process_dead(name, str(folder))  # type: ignore[no-untyped-call]
    registry = CollectorRegistry()
    MultiProcessCollector(registry, str(folder))  # type: ignore[no-untyped-call]
    return registry


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True
