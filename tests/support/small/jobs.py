"""A job for worker processes, apart from the tests: a fresh process imports it in no time."""

import os
import signal
import time


def work(job: int) -> None:
    """Crash, fail, hang or succeed."""
    if job == 1:
        os.kill(os.getpid(), signal.SIGSEGV)  # what VTK did
    if job == 2:
        raise ValueError("bad mesh")
    if job == 3:
        time.sleep(600)
