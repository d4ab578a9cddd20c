"""Servers as processes of their own, to be measured, killed and stopped; and what the kernel tells of them. Linux."""

import ctypes
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from http import HTTPStatus
from http.client import HTTPConnection
from pathlib import Path
from typing import Final

import httpx

ROOT: Final = Path(__file__).resolve().parents[2]
HOF: Final = str(Path(sys.executable).with_name("hof"))
SERVER_CORE: Final = 0  # of a server under load; the load comes from the others
START_TIMEOUT_S: Final = 120
STOP_TIMEOUT_S: Final = 20
PR_SET_PDEATHSIG: Final = 1  # linux/prctl.h: a signal for when the parent ends
STEAL: Final = 7  # proc(5): the place of it among a core's ticks
_C: Final = ctypes.CDLL(None)  # looked up before any fork


def hof(threads: int, **settings: str | int) -> list[str]:
    """The command of our own service; `{port}` stands for its port."""
    flags = [f"--{name.replace('_', '-')}={value}" for name, value in settings.items()]
    return [HOF, "serve", "--port={port}", f"--threads={threads}", *flags]


@dataclass(frozen=True)
class Served:
    """A process that serves at `url`."""

    process: subprocess.Popen[bytes]
    url: str


@contextmanager
def killable(database_url: str, *prefix: str, **settings: object) -> Iterator[Served]:
    """Start the service on a store that outlives it, and wait until it is ready; kill it in the end, if it still runs.

    Parameters
    ----------
    prefix : a command that runs another, before `hof serve`.
    settings : fields of Settings, handed over as HOF_*.
    """
    port = _free_port()
    url = f"http://127.0.0.1:{port}"
    fields = {"log_level": "error", **settings, "port": port, "database_url": database_url}
    environment = {**os.environ, **{f"HOF_{name.upper()}": str(value) for name, value in fields.items()}}
    process = subprocess.Popen([*prefix, HOF, "serve"], env=environment)
    try:
        _wait(f"{url}/health/ready", process)
        yield Served(process, url)
    finally:
        process.kill()
        process.wait()


def is_ready(url: str) -> bool:
    """Whether a new connection is told that the service is ready. Raises ConnectionError where none is taken."""
    connection = HTTPConnection(url.removeprefix("http://"), timeout=30)
    try:
        connection.request("GET", "/health/ready")
        return connection.getresponse().status == HTTPStatus.OK
    finally:
        connection.close()


@contextmanager
def serving(
    command: Sequence[str], cores: set[int], ready: str = "/health/ready", environment: Mapping[str, str] | None = None
) -> Iterator[tuple[str, int]]:
    """Start a server and its children on some cores, with a store of its own; its URL and pid. Ends them all."""
    with tempfile.TemporaryDirectory() as folder:
        port = _free_port()
        set_for_all = {
            "HOF_DATABASE_URL": f"sqlite:///{folder}/hof.db",
            "HOF_LOG_LEVEL": "warning",
            "HOF_DRAIN_S": "0",
            "PYTHONPATH": str(ROOT),
            "OPENBLAS_NUM_THREADS": "1",
            "OMP_NUM_THREADS": "1",
        }
        server = subprocess.Popen(
            [part.replace("{port}", str(port)) for part in command],
            env={**os.environ, **set_for_all, **(environment or {})},
            start_new_session=True,
            preexec_fn=lambda: _begin(cores),
        )
        try:
            _wait(f"http://127.0.0.1:{port}{ready}", server)
            yield f"http://127.0.0.1:{port}", server.pid
        finally:
            server.terminate()
            with suppress(subprocess.TimeoutExpired):
                server.wait(STOP_TIMEOUT_S)
            with suppress(ProcessLookupError):  # nobody is left, as it should be
                os.killpg(server.pid, signal.SIGKILL)  # its own session: nobody else is in it
            server.wait()


def _begin(cores: set[int]) -> None:
    """What a server does before it is one: keep to some cores, its children too, and end when we are killed."""
    os.sched_setaffinity(0, cores)
    _C.prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port: int = probe.getsockname()[1]
    return port


def _wait(url: str, server: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + START_TIMEOUT_S
    while time.monotonic() < deadline and server.poll() is None:
        try:
            if httpx.get(url).status_code == httpx.codes.OK:
                return
        except httpx.TransportError:
            pass
        time.sleep(0.1)
    raise RuntimeError(f"{server.args!r} did not become ready")


def pin_to(cores: set[int]) -> None:
    """Keep this process on some cores."""
    os.sched_setaffinity(0, cores)


def others(core: int) -> set[int]:
    """The machine's other cores; the same where there is but one."""
    return set(range(os.cpu_count() or 1)) - {core} or {core}


def status_bytes(pid: int, field: str) -> int:
    """VmRSS, VmHWM and the like."""
    for line in Path(f"/proc/{pid}/status").read_text("ascii").splitlines():
        if line.startswith(f"{field}:"):
            return int(line.split()[1]) * 1024
    raise RuntimeError(f"/proc/{pid}/status has no {field}")


def reset_peak(pid: int) -> None:
    """Let VmHWM begin anew."""
    Path(f"/proc/{pid}/clear_refs").write_text("5", "ascii")


def threads(pid: int) -> int:
    """How many threads a process has."""
    return sum(1 for _ in Path(f"/proc/{pid}/task").iterdir())


def cpu_s(pid: int) -> float:
    """Processor time of all its threads so far, to the nanosecond."""
    nanoseconds = 0
    for task in Path(f"/proc/{pid}/task").iterdir():
        try:
            nanoseconds += int((task / "schedstat").read_text("ascii").split()[0])
        except OSError:  # a thread that ended meanwhile
            continue
    return nanoseconds / 1e9


def given_s(core: int) -> float:
    """A clock that stands still while the host of a virtual machine gives a core to others (`steal`), in seconds."""
    for line in Path("/proc/stat").read_text("ascii").splitlines():
        name, *ticks = line.split()
        if name == f"cpu{core}":
            return time.perf_counter() - int(ticks[STEAL]) / os.sysconf("SC_CLK_TCK")
    raise RuntimeError(f"/proc/stat has no core {core}")
