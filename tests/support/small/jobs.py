"""Jobs for worker processes, apart from the tests so that a fresh process imports them quickly."""

import os
import signal
import time
from pathlib import Path


def work(job: int) -> None:
    """Crash, fail, hang or succeed."""
    if job == 1:
        os.kill(os.getpid(), signal.SIGSEGV)  # what VTK did
    if job == 2:
        raise ValueError("bad mesh")
    if job == 3:
        time.sleep(600)


def wait_unless_ready(target: Path) -> None:
    """Return for a target named `ready`; else write the process id to it and wait ten minutes."""
    if target.name != "ready":
        target.write_text(str(os.getpid()))
        time.sleep(600)
