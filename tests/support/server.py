"""The service for tests: in a thread over a real socket, or as `hof serve` in a process of its own."""

import contextlib
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import uvicorn

from service.api.app import create_app
from service.server.http_protocol import bounded_heads
from service.settings import Settings

ROOT = Path(__file__).parents[2]


class Server(uvicorn.Server):
    """A server and the address it is bound to."""

    @property
    def port(self) -> int:
        port: int = self.servers[0].sockets[0].getsockname()[1]
        return port


@contextlib.contextmanager
def running(settings: Settings) -> Iterator[Server]:
    """The service in a thread, over a real socket, until the block ends."""
    http = bounded_heads(settings.client_timeout_s)
    config = uvicorn.Config(create_app(settings), port=0, http=http, log_level="warning", lifespan="on", ws="none")
    server = Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started and thread.is_alive():
        time.sleep(0.005)
    assert server.started
    try:
        yield server
    finally:
        server.should_exit = True
        thread.join()


def check_refused(answer: httpx.Response, field: str, limit: str) -> None:
    """A 422 of one parameter, which it names, with its limit."""
    assert answer.status_code == 422
    (error,) = answer.json()["errors"]
    assert error["field"] == field
    assert limit in error["message"]


@contextlib.contextmanager
def hof_serve(
    folder: Path, model: Path, *flags: str, **environment: str
) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """`hof serve` in a process of its own, which logs to folder/log: its address, and the process."""
    log = folder / "log"
    command = [
        str(Path(sys.executable).with_name("hof")),
        "serve",
        "--port",
        "0",
        "--model",
        str(model),
        "--threads",
        "1",
    ]
    command += ["--database-url", f"sqlite:///{folder / 'hof.db'}", *flags]
    with log.open("wb") as file:
        process = subprocess.Popen(
            command, stderr=file, cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT), **environment}
        )
    try:
        while "startup complete" not in (text := log.read_text()) or "running on" not in text:
            assert process.poll() is None, text
            time.sleep(0.05)
        yield text.split("running on ")[1].split()[0], process
    finally:
        process.terminate()
        process.wait(60)
