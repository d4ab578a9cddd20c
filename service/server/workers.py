"""Several processes that serve one port, watched and replaced by uvicorn's supervisor."""

import contextlib
import logging
import os
import signal
import socket
import time
from typing import Final

from uvicorn.config import STARTUP_FAILURE
from uvicorn.supervisors.multiprocess import Multiprocess, Process

from service.server.process import Config, Server

logger: Final = logging.getLogger("uvicorn.error")

RETIRE: Final = signal.SIGUSR1
PARENT_CHECK_S: Final = 0.1
READY_CHECK_S: Final = 1.0  # longest wait for a worker's word on whether it is ready


class Worker(Process):
    """One of several processes, with our server instead of uvicorn's."""

    config: Config

    def __init__(self, config: Config, sockets: list[socket.socket]) -> None:
        super().__init__(config, sockets)
        self._parent_pid = os.getpid()
        self.started_at = time.monotonic()

    @property
    def server(self) -> Server:
        """The server, created in the worker process itself."""
        if not isinstance(self._server, Server):
            self._server = Server(self.config)
        return self._server

    def start(self) -> None:
        """Start the process. Its end of the pipe is closed here: if it dies, a health check ends at once."""
        super().start()
        self.child_conn.close()

    def target(self, sockets: list[socket.socket] | None = None) -> None:
        """Serve, in the worker process. The supervisor's end of the pipe is closed: if it dies, the pipe ends."""
        self.parent_conn.close()
        signal.signal(RETIRE, lambda *_: self.server.retire())
        super().target(sockets)

    def always_pong(self) -> None:
        """Answer health checks; stop this worker if the supervisor dies."""
        with contextlib.suppress(EOFError, OSError):
            super().always_pong()
        while os.getppid() == self._parent_pid:
            time.sleep(PARENT_CHECK_S)
        logger.error("the supervisor has ended, so this worker stops")
        if not self.server.started:
            os.kill(os.getpid(), signal.SIGTERM)
        self.server.should_exit = True  # without draining: the port is needed by the next start

    def retire(self) -> None:
        """Let the process end once its calls have, however long they take."""
        if self.process.pid is not None and self.process.is_alive():
            os.kill(self.process.pid, RETIRE)


class Supervisor(Multiprocess):
    """Uvicorn's supervisor with workers of our class, which never waits for one of them to end.

    Uvicorn has no setting for the class, so each method that creates a process is overridden here (uvicorn 0.54;
    pyproject.toml limits the version).
    """

    config: Config

    def __init__(self, config: Config, sockets: list[socket.socket]) -> None:
        super().__init__(config, sockets)
        self._outdated: list[Process] = []  # to be replaced, in order
        self._successor: Worker | None = None  # of the first outdated worker
        self._retired: list[Process] = []

    def init_processes(self) -> None:
        """Start all workers."""
        self.processes.extend(self._start() for _ in range(self.processes_num))

    def keep_subprocess_alive(self) -> None:
        """Replace workers that have ended or hang, and outdated ones. Stop the service if a worker cannot start.

        A worker whose database does not answer waits for it (`Store.open_once_reachable`).
        """
        for index, process in enumerate(self.processes):
            if self.should_exit.is_set():
                return
            if process.is_alive(timeout=self.config.timeout_worker_healthcheck):
                continue
            process.kill()
            process.join()
            if process.exitcode == STARTUP_FAILURE:
                logger.error("worker %s cannot start; the service stops", process.pid)
                self.should_exit.set()
            if not self.should_exit.is_set():
                logger.info("worker %s ended; a new one starts", process.pid)
                self.processes[index] = self._start()
        self._retired = [process for process in self._retired if process.process.is_alive()]
        self._continue_restart()

    def restart_all(self) -> None:
        """Replace the workers one by one, each as soon as its successor is ready (SIGHUP)."""
        self._outdated = list(self.processes)

    def _continue_restart(self) -> None:
        """Start the next successor, or let the worker before it retire."""
        self._outdated = [process for process in self._outdated if process in self.processes]
        successor = self._successor
        if successor is None:
            self._successor = self._start() if self._outdated else None
            return
        is_running = successor.process.is_alive()
        if is_running and self._outdated and successor.is_ready(READY_CHECK_S):
            worker = self._outdated.pop(0)
            self.processes[self.processes.index(worker)] = successor
            self._retire(worker)
            self._successor = None
        elif not (is_running and self._outdated) or time.monotonic() - successor.started_at > self._patience_s:
            logger.error("worker %s was not ready in time; the restart stops", successor.pid)
            successor.kill()
            successor.join()
            self._successor, self._outdated = None, []

    @property
    def _patience_s(self) -> float:
        return float(self.config.timeout_worker_healthcheck)

    def terminate_all(self) -> None:
        """End all workers, retiring ones too. The last one to close the port serves its waiting clients."""
        for listener in self.sockets:
            listener.close()
        self.processes += [*self._retired, *([self._successor] if self._successor else [])]
        super().terminate_all()

    def handle_ttin(self) -> None:
        """Add a worker (SIGTTIN)."""
        self.processes_num += 1
        self.processes.append(self._start())

    def handle_ttou(self) -> None:
        """Let a worker retire, unless it is the last one (SIGTTOU)."""
        if self.processes_num > 1:
            self.processes_num -= 1
            self._retire(self.processes.pop())

    def _retire(self, worker: Process) -> None:
        if isinstance(worker, Worker):
            worker.retire()
            self._retired.append(worker)

    def _start(self) -> Worker:
        worker = Worker(self.config, self.sockets)
        worker.start()
        return worker
