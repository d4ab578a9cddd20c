"""Keep freed memory in the process: a training step allocates the same 100 MB blocks every time."""

from typing import Final

from service.memory import mallopt

M_TRIM_THRESHOLD: Final = -1  # malloc.h
M_MMAP_MAX: Final = -4


def keep_freed_memory() -> bool:
    """Tell glibc to reuse large freed blocks, not to return them to the kernel and fault them in anew.

    It made a training step about a quarter shorter. Returns whether the C library took it.
    """
    return mallopt(M_MMAP_MAX, 0) and mallopt(M_TRIM_THRESHOLD, 2**31 - 1)
