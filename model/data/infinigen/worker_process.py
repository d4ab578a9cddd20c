"""A process that answers one request at a time, and may hang, crash or answer nonsense."""

import json
import os
import select
import signal
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import IO, Any, Final, Self, cast

START_S: Final = 600  # longest start: it reads hundreds of megabytes
TICK_S: Final = 1.0
MAX_ANSWER_BYTES: Final = 10_000


class WorkerLost(ChildProcessError):
    """The process gave no usable answer, and has ended."""


class Worker:
    """A program that reads requests as lines of JSON and answers each with one; its first line says that it is ready.

    Raises
    ------
    WorkerLost : it did not start; the last line that it printed may tell why.
    """

    def __init__(self, command: Sequence[str | Path], start_s: float = START_S) -> None:
        with tempfile.TemporaryFile() as errors:
            self._process = subprocess.Popen(  # noqa: S603 - our own program
                command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors
            )
            self._requests, self._answers = cast(IO[bytes], self._process.stdin), cast(IO[bytes], self._process.stdout)
            try:
                self._answer(start_s)
            except WorkerLost as lost:
                raise WorkerLost(f"{command[0]} did not start: it {lost}. {_last_line(errors)}".strip()) from lost
            except BaseException:
                self.close()
                raise

    def ask(self, request: Mapping[str, Any], patience_s: float) -> dict[str, Any]:
        """Send a request and return the answer.

        Raises
        ------
        WorkerLost : no answer within `patience_s`, an answer that is no JSON object, or the process ended.
        """
        try:
            self._requests.write(json.dumps(request).encode() + b"\n")
            self._requests.flush()
        except BrokenPipeError:
            raise self._lost("crashed") from None
        return self._answer(patience_s)

    def close(self) -> None:
        """End the process."""
        self._process.kill()
        self._process.communicate()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _answer(self, patience_s: float) -> dict[str, Any]:
        """Read one line. A pause of the whole program counts as one tick, however long it is."""
        pipe, line, waited_s = self._answers.fileno(), b"", 0.0
        while not line.endswith(b"\n") and len(line) < MAX_ANSWER_BYTES:
            start = time.monotonic()
            if select.select([pipe], [], [], TICK_S)[0]:
                chunk = os.read(pipe, MAX_ANSWER_BYTES)
                if not chunk:
                    raise self._lost("crashed")
                line += chunk
            waited_s += min(time.monotonic() - start, TICK_S)
            if waited_s > patience_s:
                raise self._lost(f"gave no answer for {patience_s:g} s")
        try:
            answer = json.loads(line)
        except ValueError:
            answer = None
        if not isinstance(answer, dict):
            raise self._lost(f"answered {line[:40]!r}, which is no JSON object")
        return answer

    def _lost(self, reason: str) -> WorkerLost:
        """End the process and return the error that says why."""
        code = self._process.wait() if reason == "crashed" else 0
        self.close()
        if code == -signal.SIGXCPU:
            return WorkerLost("took more processor time than allowed")
        return WorkerLost(f"{reason} ({signal.Signals(-code).name})" if code < 0 else reason)


def _last_line(file: IO[bytes]) -> str:
    """Return the last line of a file that is not empty, or nothing."""
    file.seek(0)
    lines = [line.strip() for line in file.read().decode(errors="replace").splitlines()]
    return next((line for line in reversed(lines) if line), "")
