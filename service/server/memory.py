"""How the C library and Python keep this process's memory."""

import ctypes
import gc
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


def keep_for_good() -> None:
    """Leave all objects that there are out of every later garbage collection.

    A start makes several hundred thousand, which stay. Under load a full collection looked through them every few
    seconds, and nobody was answered meanwhile.
    """
    gc.collect()
    gc.freeze()
    gc.collect()  # which counts what is left: a quarter more of that, and the next full collection is due
