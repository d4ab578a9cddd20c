"""Several processes that serve one port, watched and replaced by uvicorn's supervisor."""

import logging
from typing import Final

from uvicorn.config import STARTUP_FAILURE
from uvicorn.supervisors.multiprocess import Multiprocess, Process

from service.server.process import Config, Server

logger: Final = logging.getLogger("uvicorn.error")


class Worker(Process):
    """One of several processes, with our server instead of uvicorn's."""

    config: Config

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


class Supervisor(Multiprocess):
    """Uvicorn's supervisor with workers of our class.

    Uvicorn has no setting for the class, so each method that creates a process is overridden here (uvicorn 0.54;
    pyproject.toml limits the version).
    """

    config: Config

    def init_processes(self) -> None:
        """Start all workers."""
        self.processes.extend(self._start() for _ in range(self.processes_num))

    def keep_subprocess_alive(self) -> None:
        """Replace workers that have ended or hang. Stop the service if a worker cannot start."""
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

    def restart_all(self) -> None:
        """Replace the workers one by one, each as soon as its successor is ready (SIGHUP)."""
        for index, process in enumerate(self.processes):
            successor = self._start()
            if not successor.wait_until_ready(self.config.timeout_worker_healthcheck, self.should_exit):
                successor.kill()
                successor.join()
                if not self.should_exit.is_set():
                    logger.error("worker %s was not ready in time; the restart stops", successor.pid)
                return
            process.terminate()
            process.join()
            self.processes[index] = successor

    def handle_ttin(self) -> None:
        """Add a worker (SIGTTIN)."""
        self.processes_num += 1
        self.processes.append(self._start())

    def _start(self) -> Worker:
        worker = Worker(self.config, self.sockets)
        worker.start()
        return worker
