"""Ctrl-C during a command: its exit status is 130, and it prints no traceback."""

import os
import signal
import subprocess
import time
from pathlib import Path

import pytest

from tests.support import ROOT
from tests.support.processes import HOF

TIMEOUT_S = 60


def _slow_module(folder: Path, name: str) -> Path:
    """Write a module that hides the real one: its import creates a file, which is returned, and then takes minutes."""
    started = folder / "started"
    code = f"import time\nfrom pathlib import Path\nPath({str(started)!r}).touch()\ntime.sleep(600)\n"
    (folder / f"{name}.py").write_text(code)
    return started


def _interrupted(command: list[str], environment: dict[str, str], sign: Path) -> tuple[int, bytes]:
    """Run a command, and send SIGINT to its processes as a terminal does, once a file exists.

    Return its exit status and stderr.
    """
    with subprocess.Popen(command, stderr=subprocess.PIPE, env=environment, start_new_session=True) as process:
        deadline = time.monotonic() + TIMEOUT_S
        while not sign.exists():
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.01)
        os.killpg(process.pid, signal.SIGINT)
        try:
            _, errors = process.communicate(timeout=TIMEOUT_S)
        finally:
            process.kill()  # if it goes on, the test has failed and does not wait for it
    return process.returncode, errors


@pytest.mark.parametrize(
    ("command", "module"),
    [
        ("hof info a.safetensors", "numpy"),
        ("hof serve", "uvicorn"),
        ("hof-model evaluate", "numpy"),
        ("hof-model evaluate --model none.onnx", "torch"),
    ],
)
def test_command_that_is_interrupted_while_it_imports_ends_without_a_traceback(
    tmp_path: Path, command: str, module: str
) -> None:
    started = _slow_module(tmp_path, module)
    program, *arguments = command.split()
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
    run = [str(Path(HOF).with_name(program)), *arguments]
    assert _interrupted(run, environment, started) == (130, b"")
