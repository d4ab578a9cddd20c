"""Servers in processes of their own, to be measured, killed and stopped. Linux."""

import ctypes
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from http import HTTPStatus
from http.client import HTTPConnection
from pathlib import Path
from typing import IO, Final, NamedTuple

import httpx

from service.settings import SHIPPED_MODEL
from tests.support import ROOT

HOF: Final = str(Path(sys.executable).with_name("hof"))
START_TIMEOUT_S: Final = 120
STOP_TIMEOUT_S: Final = 20
PR_SET_PDEATHSIG: Final = 1  # linux/prctl.h: a signal for when the parent ends
# Runs a command as a user without a passwd entry and without a home folder; only root can. That user may read and write
# all files, since Python and the tests' folders may be closed to it.
USER_WITHOUT_HOME: Final = (
    *("setpriv", "--reuid=12345", "--regid=12345", "--clear-groups"),
    *("--inh-caps=+dac_override", "--ambient-caps=+dac_override"),
    *("env", "-u", "HOME", "-u", "XDG_DATA_HOME"),
)
_C: Final = ctypes.CDLL(None)  # looked up before any fork


class Served(NamedTuple):
    """A process that serves at `url`."""

    url: str
    process: subprocess.Popen[bytes]


def flags(**settings: object) -> list[str]:
    """Return the flags of `hof serve` for fields of Settings."""
    return [f"--{name.replace('_', '-')}={value}" for name, value in settings.items()]


def hof(threads: int, **settings: object) -> list[str]:
    """Return the command of the service; `{port}` in it stands for its port."""
    return [HOF, "serve", "--port={port}", f"--threads={threads}", *flags(**settings)]


@contextmanager
def hof_serve(
    folder: Path,
    model: Path = SHIPPED_MODEL,
    *flags: str,
    prefix: Sequence[str] = (),
    command: Sequence[str] = (HOF,),
    **environment: str,
) -> Iterator[Served]:
    """Run `hof serve` on a free port with its database at folder/hof.db and its log at folder/log; end it at last.

    It drains for no time unless a flag says otherwise.

    Parameters
    ----------
    prefix : a command that runs another, before `hof serve`.
    command : what runs instead of `hof`.

    """
    log = folder / "log"
    line = [*prefix, *command, "serve", "--port=0", f"--model={model}", "--threads=1"]
    line += [f"--database-url=sqlite:///{folder / 'hof.db'}", *flags]
    settings = {"HOF_DRAIN_S": "0", **environment}
    with log.open("wb") as file, _running(line, settings, stderr=file, cwd=folder) as process:
        deadline = time.monotonic() + START_TIMEOUT_S
        while "startup complete" not in (text := log.read_text()) or "running on" not in text:
            assert process.poll() is None, text
            assert time.monotonic() < deadline, text
            time.sleep(0.05)
        yield Served(text.split("running on ")[1].split()[0], process)


@contextmanager
def serving(
    command: Sequence[str], cores: set[int], ready: str = "/health/ready", environment: Mapping[str, str] | None = None
) -> Iterator[tuple[str, int]]:
    """Run any server on some cores, with a store of its own, until the block ends; its URL and pid.

    Parameters
    ----------
    command : `{port}` in it stands for the server's port.
    ready : path that answers 200 once the server is up.

    """
    with tempfile.TemporaryDirectory() as folder:
        port = free_port()
        settings = {
            "HOF_DATABASE_URL": f"sqlite:///{folder}/hof.db",
            "HOF_LOG_LEVEL": "warning",
            "HOF_DRAIN_S": "0",
            "OPENBLAS_NUM_THREADS": "1",
            "OMP_NUM_THREADS": "1",
            **(environment or {}),
        }
        command = [part.replace("{port}", str(port)) for part in command]
        with _running(command, settings, preexec_fn=lambda: _begin(cores)) as server:
            _wait(f"http://127.0.0.1:{port}{ready}", server)
            yield f"http://127.0.0.1:{port}", server.pid


@contextmanager
def _running(
    command: Sequence[str],
    environment: Mapping[str, str],
    *,
    stderr: IO[bytes] | None = None,
    cwd: Path | None = None,
    preexec_fn: Callable[[], None] | None = None,
) -> Iterator[subprocess.Popen[bytes]]:
    """Start a process in a session of its own; in the end stop it, and kill what it leaves behind.

    It runs without matting, unless `environment` names a model.
    """
    process = subprocess.Popen(
        command,
        env={"HOF_MATTING_MODEL": "none", **os.environ, "PYTHONPATH": str(ROOT), **environment},
        stderr=stderr,
        cwd=cwd,
        preexec_fn=preexec_fn,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        process.terminate()
        with suppress(subprocess.TimeoutExpired):
            process.wait(STOP_TIMEOUT_S)
        with suppress(ProcessLookupError):  # nobody is left, as it should be
            os.killpg(process.pid, signal.SIGKILL)  # nobody else is in its session
        process.wait()


def _begin(cores: set[int]) -> None:
    """Keep a new process and its children to some cores, and let it end when its parent is killed."""
    os.sched_setaffinity(0, cores)
    _C.prctl(PR_SET_PDEATHSIG, signal.SIGTERM)


def free_port() -> int:
    """Return a port of the loopback interface that nobody listens on."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port: int = probe.getsockname()[1]
    return port


def worker_pids(supervisor: int) -> list[int]:
    """Return the worker processes of a service's supervisor, oldest first."""
    children = Path(f"/proc/{supervisor}/task/{supervisor}/children").read_text().split()
    return [int(pid) for pid in children if b"spawn_main" in Path(f"/proc/{pid}/cmdline").read_bytes()]


def is_ready(url: str) -> bool:
    """Return whether the service tells a new connection that it is ready.

    Raises
    ------
    ConnectionError : it accepts no connection.

    """
    connection = HTTPConnection(url.removeprefix("http://"), timeout=30)
    try:
        connection.request("GET", "/health/ready")
        return connection.getresponse().status == HTTPStatus.OK
    finally:
        connection.close()


def _wait(url: str, server: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + START_TIMEOUT_S
    while time.monotonic() < deadline and server.poll() is None:
        with suppress(httpx.TransportError):
            if httpx.get(url).status_code == httpx.codes.OK:
                return
        time.sleep(0.1)
    raise RuntimeError(f"{server.args!r} was not ready after {START_TIMEOUT_S} s")


def dying_python(folder: Path) -> bytes:
    """Write a program that is Python, but kills itself where multiprocessing starts it to work; return its path."""
    program = folder / "python"
    program.write_text(f'#!/bin/sh\ncase "$*" in *spawn_main*) kill -9 $$;; esac\nexec {sys.executable} "$@"\n')
    program.chmod(0o700)
    return os.fsencode(program)
