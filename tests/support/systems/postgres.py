"""A PostgreSQL of the tests' own: Debian's server in a temporary folder, on loopback, and PgBouncer before it."""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Literal

import pytest

from tests.support.processes import free_port

USER = "postgres"  # neither server runs as root
FAST = "-c fsync=off -c synchronous_commit=off -c full_page_writes=off -c shared_buffers=16MB -c max_connections=50"
START_TIMEOUT_S = 120


class Postgres:
    """A running server; each `create` is an empty database of its own.

    folder : holds its data, its log and its Unix socket.
    """

    def __init__(self, folder: Path, port: int, options: str = "") -> None:
        self.folder = folder
        self.port = port
        self._options = f"-k {folder} -h 127.0.0.1 -p {port} {FAST} {options}"
        control = [tool("pg_ctl"), "-D", str(folder / "data"), "-w", "-t", str(START_TIMEOUT_S)]
        self._control = [*unprivileged(), *control]
        self._names = (f"hof_{number}" for number in count(1))

    def create(self) -> str:
        """Create a database and return its URL."""
        name = next(self._names)
        self.run(f"CREATE DATABASE {name}", "postgres")
        return f"postgresql://{USER}@127.0.0.1:{self.port}/{name}"

    def run(self, sql: str, database: str) -> str:
        """Run SQL and return the output of psql."""
        connection = ["-h", "127.0.0.1", "-p", str(self.port), "-U", USER, "-d", database]
        command = [tool("psql"), *connection, "-X", "-q", "-A", "-t", "-v", "ON_ERROR_STOP=1", "-c", sql]
        environment = {**os.environ, "PGOPTIONS": "-c default_transaction_read_only=off -c statement_timeout=0"}
        return subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout.strip()

    def start(self) -> None:
        """Start the server, and wait until it accepts connections."""
        start = [*self._control, "-l", str(self.folder / "log"), "-o", self._options, "start"]
        subprocess.run(start, check=True, stdout=subprocess.DEVNULL, cwd=self.folder)

    def stop(self, mode: Literal["fast", "immediate"] = "fast") -> None:
        """Stop the server: `fast` ends all connections, `immediate` forgets the last transactions too."""
        stop = [*self._control, "-m", mode, "stop"]
        subprocess.run(stop, check=True, stdout=subprocess.DEVNULL, cwd=self.folder)

    @contextmanager
    def frozen(self) -> Iterator[None]:
        """Stop all processes of the server until the block ends; the kernel still accepts connections for them."""
        pids = self.pids()
        _signal(pids, signal.SIGSTOP)
        try:
            yield
        finally:
            _signal(pids, signal.SIGCONT)

    @contextmanager
    def standby(self) -> Iterator["Postgres"]:
        """Run a copy of this server that follows it and accepts no writes, until the block ends."""
        with _folder() as folder:
            source = ["-h", "127.0.0.1", "-p", str(self.port), "-U", USER]
            copy = [tool("pg_basebackup"), *source, "-D", str(folder / "data"), "-R", "-c", "fast", "--no-sync"]
            subprocess.run([*unprivileged(), *copy], check=True, capture_output=True, cwd=folder)
            with _started(folder, "") as server:
                yield server

    def pids(self) -> list[int]:
        """Return the server's processes: the first one, and those of its connections and housekeeping."""
        pid = (self.folder / "data" / "postmaster.pid").read_text().split()[0]
        return [int(pid), *map(int, Path(f"/proc/{pid}/task/{pid}/children").read_text().split())]

    def promote(self) -> None:
        """Let a standby accept writes, and wait until it does."""
        subprocess.run([*self._control, "promote"], check=True, stdout=subprocess.DEVNULL, cwd=self.folder)

    @contextmanager
    def bouncer(self, url: str, port: int | None = None, connections: int = 2) -> Iterator[str]:
        """Run PgBouncer, with connections shared by transaction; the URL of the same database through it."""
        port = port or free_port()
        path = self.folder / f"bouncer-{port}.ini"
        path.write_text(
            f"[databases]\n* = host=127.0.0.1 port={self.port} user={USER}\n[pgbouncer]\nlisten_addr=127.0.0.1\n"
            f"listen_port={port}\nunix_socket_dir=\nauth_type=any\npool_mode=transaction\n"
            f"default_pool_size={connections}\n"
        )
        with subprocess.Popen([*unprivileged(), tool("pgbouncer"), "--quiet", str(path)]) as process:
            try:
                wait_for_port(port, process)
                yield url.replace(f":{self.port}/", f":{port}/")
            finally:
                process.terminate()


@contextmanager
def running_postgres(options: str = "") -> Iterator[Postgres]:
    """Run the server until the block ends. It is quick because it writes nothing safe from a crash of the machine."""
    with _folder() as folder:
        setup = [tool("initdb"), "-D", str(folder / "data"), "-U", USER, "-A", "trust", "-E", "UTF8", "--no-sync"]
        subprocess.run([*unprivileged(), *setup], check=True, capture_output=True, cwd=folder)
        with _started(folder, options) as server:
            yield server


@contextmanager
def _folder() -> Iterator[Path]:
    """Make a temporary folder that belongs to the server's user."""
    with tempfile.TemporaryDirectory(prefix="hof-postgres-") as name:
        folder = Path(name)
        if os.geteuid() == 0:
            shutil.chown(folder, USER)
        yield folder


@contextmanager
def _started(folder: Path, options: str) -> Iterator[Postgres]:
    """Run the server whose data are in a folder until the block ends."""
    server = Postgres(folder, free_port(), options)
    server.start()
    try:
        yield server
    finally:
        server.stop("immediate")


def unprivileged() -> list[str]:
    """Return what runs a command as a user that the servers accept."""
    return ["setpriv", f"--reuid={USER}", f"--regid={USER}", "--clear-groups"] if os.geteuid() == 0 else []


def tool(name: str) -> str:
    """Return a program on the path, or of the newest PostgreSQL where Debian puts it."""
    folders = sorted(Path("/usr/lib/postgresql").glob("*/bin"), key=lambda folder: int(folder.parent.name))
    path = shutil.which(name, path=os.pathsep.join([*map(str, reversed(folders)), os.environ["PATH"], "/usr/sbin"]))
    assert path, f"the tests need {name}: tests/support/system.sh installs it"
    return path


def wait_for_port(port: int, process: subprocess.Popen[bytes]) -> None:
    """Wait until the port accepts a connection."""
    deadline = time.monotonic() + START_TIMEOUT_S
    while time.monotonic() < deadline:
        assert process.poll() is None, f"{process.args!r} ended"
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), timeout=1):
            return
        time.sleep(0.05)
    raise AssertionError(f"{process.args!r} does not answer")


EVERY_DATABASE = pytest.mark.parametrize("database_url", ["sqlite", "postgresql"], indirect=True)


def _signal(pids: list[int], number: signal.Signals) -> None:
    """Send a signal to processes; a backend whose client left may have ended meanwhile."""
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, number)
