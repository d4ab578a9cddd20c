"""Cores, memory, threads and processor time of processes, as Linux reports them."""

import os
import time
from pathlib import Path
from typing import Final

SERVER_CORE: Final = 0  # of a server under load; the load comes from the others
STEAL: Final = 7  # proc(5): its place among a core's ticks


def pin_to(cores: set[int]) -> None:
    """Keep this process on some cores."""
    os.sched_setaffinity(0, cores)


def others(core: int) -> set[int]:
    """Return the machine's other cores; the same one where there is but one."""
    return set(range(os.cpu_count() or 1)) - {core} or {core}


def status_bytes(pid: int, field: str) -> int:
    """Return a size of a process in bytes: VmRSS, VmHWM and the like."""
    for line in Path(f"/proc/{pid}/status").read_text("ascii").splitlines():
        if line.startswith(f"{field}:"):
            return int(line.split()[1]) * 1024
    raise RuntimeError(f"/proc/{pid}/status has no {field}")


def reset_peak(pid: int) -> None:
    """Set VmHWM, the peak of resident memory, to what is resident now."""
    Path(f"/proc/{pid}/clear_refs").write_text("5", "ascii")


def threads(pid: int) -> int:
    """Return the number of threads of a process."""
    return sum(1 for _ in Path(f"/proc/{pid}/task").iterdir())


def cpu_s(pid: int) -> float:
    """Processor time of all threads of a process so far, in seconds, exact to the nanosecond."""
    nanoseconds = 0
    for task in Path(f"/proc/{pid}/task").iterdir():
        try:
            nanoseconds += int((task / "schedstat").read_text("ascii").split()[0])
        except OSError:  # a thread that ended meanwhile
            continue
    return nanoseconds / 1e9


def given_s(core: int) -> float:
    """Read a clock, in seconds, that stands still while a virtual machine's host gives the core to others (`steal`)."""
    for line in Path("/proc/stat").read_text("ascii").splitlines():
        name, *ticks = line.split()
        if name == f"cpu{core}":
            return time.perf_counter() - int(ticks[STEAL]) / os.sysconf("SC_CLK_TCK")
    raise RuntimeError(f"/proc/stat has no core {core}")


def processor_ns(pid: int) -> int:
    """Return the processor time of a process's main thread, in which a server's event loop runs, in nanoseconds."""
    return int(Path(f"/proc/{pid}/schedstat").read_text().split()[0])
