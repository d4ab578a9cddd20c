"""Memory of this process: arenas of the C library and the garbage collector of Python."""

import ctypes
import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Final

M_ARENA_MAX: Final = -8  # malloc.h
VARIABLE: Final = "MALLOC_ARENA_MAX"


def share_one_arena() -> bool:
    """Let all threads that start later allocate from one arena, in this process and its children.

    glibc gives each thread an arena of its own, which keeps the memory of that thread's largest image or cloud: much
    of the service's resident memory, and the reason why it grew for hours (`make soak`). If the user sets VARIABLE,
    nothing changes. Returns whether the C library accepted the setting.
    """
    if not sys.platform.startswith("linux") or VARIABLE in os.environ:
        return False
    try:
        mallopt = ctypes.CDLL("libc.so.6").mallopt
    except (OSError, AttributeError):  # another C library
        return False
    os.environ[VARIABLE] = "1"  # glibc reads it when a child process starts, before that has a thread
    return bool(mallopt(M_ARENA_MAX, 1))


def release_unused_memory() -> None:
    """Return to the system what the C library holds free: after a start about 50 MiB that loading the models took."""
    with suppress(OSError, AttributeError):  # another C library
        ctypes.CDLL("libc.so.6").malloc_trim(0)


@contextmanager
def importing() -> Iterator[None]:
    """Import modules without garbage collections, and exclude what they create from later ones.

    Imports create hundreds of thousands of objects and almost no garbage: looking for it took up to a tenth of a start.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        if was_enabled:
            gc.enable()


def freeze_startup_objects() -> None:
    """Exclude all current objects from later garbage collections.

    Startup creates several hundred thousand objects that live as long as the process. Under load, a full collection
    scanned them every few seconds and stopped all answers meanwhile.
    """
    gc.collect()
    gc.freeze()
    gc.collect()  # resets the count of surviving objects: the next full collection comes when a quarter more survive
