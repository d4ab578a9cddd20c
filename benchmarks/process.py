"""`hof serve` as a process of its own, on a free port: what is measured, killed and stopped."""

import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from http import HTTPStatus
from http.client import HTTPConnection
from pathlib import Path
from typing import Final

START_TIMEOUT_S: Final = 120


@dataclass(frozen=True)
class Served:
    """A process that serves at `url`."""

    process: subprocess.Popen[bytes]
    url: str


@contextmanager
def serving(database_url: str, *prefix: str, **settings: object) -> Iterator[Served]:
    """Start the service and wait until it is ready; kill it in the end, if it still runs.

    Parameters
    ----------
    prefix : a command that runs another, before `hof serve`.
    settings : fields of Settings, handed over as HOF_*.
    """
    port = _free_port()
    url = f"http://127.0.0.1:{port}"
    fields = {"log_level": "error", **settings, "port": port, "database_url": database_url}
    environment = {**os.environ, **{f"HOF_{name.upper()}": str(value) for name, value in fields.items()}}
    command = [*prefix, str(Path(sys.executable).with_name("hof")), "serve"]
    process = subprocess.Popen(command, env=environment)  # noqa: S603
    try:
        _wait(url, process)
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


def _wait(url: str, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + START_TIMEOUT_S
    while time.monotonic() < deadline and process.poll() is None:
        try:
            if is_ready(url):
                return
        except ConnectionError:
            time.sleep(0.05)
    raise RuntimeError("hof serve did not become ready")


def _free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port: int = probe.getsockname()[1]
    return port
