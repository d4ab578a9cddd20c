"""Jobs for worker processes, apart from the tests so that a fresh process imports them quickly."""

import os
import signal
import time
from pathlib import Path


def work(job: int) -> str | None:
    """Crash, fail, hang or succeed, job 5 with a remark."""
    if job == 1:
        os.kill(os.getpid(), signal.SIGSEGV)  # what VTK did
    if job == 2:
        raise ValueError("bad mesh")
    if job == 3:
        time.sleep(600)
    return "half of it" if job == 5 else None


def wait_unless_ready(target: Path) -> None:
    """Return for a target named `ready`; else write the process id to it and wait ten minutes."""
    if target.name != "ready":
        target.write_text(str(os.getpid()))
        time.sleep(600)
