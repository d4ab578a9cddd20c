"""Several processes that serve one database: replicas with a port each, or the workers of one service."""

import os
import random
import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final, Protocol

from tests.support.processes import Served, flags, free_port, hof_serve, worker_pids

STARTED: Final = b"startup complete"
DEADLINE_S: Final = 120.0
POLL_S: Final = 0.05


class Fleet(Protocol):
    """Processes that serve one database."""

    @property
    def urls(self) -> Sequence[str]:
        """Return the URL of each replica; a single one for workers, which share a port."""

    def kill_one(self, draw: random.Random) -> None:
        """Kill one of the processes with SIGKILL, and return when another serves in its place."""

    def pids(self) -> list[int]:
        """Return the processes that serve."""


class Replicas:
    """Replicas of one service, each with its own port, folder and log."""

    def __init__(self, count: int, folder: Path, model: Path, *settings: str) -> None:
        self._model, self._settings = model, settings
        self._folders = [folder / f"replica-{number}" for number in range(count)]
        self._ports = [free_port() for _ in range(count)]
        self._stacks = [ExitStack() for _ in range(count)]
        self._served: dict[int, Served] = {}
        for replica in self._folders:
            replica.mkdir()

    @property
    def urls(self) -> Sequence[str]:
        """Return the URL of each replica, also of one that is down."""
        return [f"http://127.0.0.1:{port}" for port in self._ports]

    def pids(self) -> list[int]:
        """Return the processes that serve."""
        return [served.process.pid for served in self._served.values()]

    def start(self, number: int) -> None:
        """Start a replica and wait until it serves."""
        command = hof_serve(self._folders[number], self._model, *self._settings, f"--port={self._ports[number]}")
        self._served[number] = self._stacks[number].enter_context(command)

    def stop(self) -> None:
        """Stop all replicas."""
        for stack in self._stacks:
            stack.close()

    def kill_one(self, draw: random.Random) -> None:
        """Kill one of the replicas and start it again (`Fleet.kill_one`)."""
        number = draw.randrange(len(self._folders))
        self._served[number].process.kill()
        self._served[number].process.wait()
        self._stacks[number].close()
        _check_log((self._folders[number] / "log").read_text())
        self.start(number)


class Workers:
    """Workers of one service, which its supervisor replaces."""

    def __init__(self, served: Served, log: Path) -> None:
        self.urls: Sequence[str] = [served.url]
        self._served, self._log = served, log

    def pids(self) -> list[int]:
        """Return the processes that serve."""
        return worker_pids(self._served.process.pid)

    def kill_one(self, draw: random.Random) -> None:
        """Kill one of the workers, and wait for its successor (`Fleet.kill_one`)."""
        start = self._log.stat().st_size
        os.kill(draw.choice(self.pids()), signal.SIGKILL)
        _wait_for_starts(self._log, start, 1)


@contextmanager
def running_replicas(count: int, folder: Path, model: Path, database_url: str) -> Iterator[Replicas]:
    """Run replicas on one database until the block ends."""
    fleet = Replicas(count, folder, model, *flags(database_url=database_url, database_connections=5))
    try:
        for number in range(count):
            fleet.start(number)
        yield fleet
    finally:
        fleet.stop()


@contextmanager
def running_workers(count: int, folder: Path, model: Path) -> Iterator[Workers]:
    """Run the workers of one service on a SQLite file, folder/hof.db, until the block ends."""
    with hof_serve(folder, model, *flags(workers=count)) as served:
        _wait_for_starts(folder / "log", 0, count)
        yield Workers(served, folder / "log")
    _check_log((folder / "log").read_text())


def _wait_for_starts(log: Path, start: int, count: int) -> None:
    """Wait until so many processes have logged their start behind a place in the log."""
    deadline = time.monotonic() + DEADLINE_S
    with log.open("rb") as file:
        while True:
            file.seek(start)
            if file.read().count(STARTED) >= count:
                return
            assert time.monotonic() < deadline, f"{count} processes did not start in {DEADLINE_S:.0f} s"
            time.sleep(POLL_S)


def _check_log(text: str) -> None:
    assert "Traceback" not in text, text[text.index("Traceback") :][:4000]
