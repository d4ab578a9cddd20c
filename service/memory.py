"""How the C library keeps this process's memory."""

import ctypes
import os
import sys
from typing import Final

M_ARENA_MAX: Final = -8  # malloc.h
VARIABLE: Final = "MALLOC_ARENA_MAX"


def share_one_arena() -> bool:
    """Let all threads that begin later allocate from one arena, in this process and in those that it starts.

    glibc gives each thread an arena of its own, which keeps what its largest image or cloud took: much of the
    service's resident memory, and what made it grow for hours (`make soak`). Whoever sets VARIABLE is left alone.
    Returns whether the C library took it.
    """
    if not sys.platform.startswith("linux") or VARIABLE in os.environ:
        return False
    try:
        mallopt = ctypes.CDLL("libc.so.6").mallopt
    except (OSError, AttributeError):  # another C library
        return False
    os.environ[VARIABLE] = "1"  # which glibc reads when a process starts, before that has a thread
    return bool(mallopt(M_ARENA_MAX, 1))
