"""Provenance of a result: machine, date, commit."""

import os
import platform
import subprocess
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parent.parent
REPORTS: Final = ("*.md", "*.png", "benchmarks/load.json", "model/results")  # written by runs: they change no figure


def provenance(seed: int) -> dict[str, str | int]:
    """Return the machine, date (UTC), seed and commit of a run, for the head of a results file."""
    return {
        "machine": f"{_processor()}, {os.cpu_count()} cores, {platform.system()}, Python {platform.python_version()}",
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
        "seed": seed,
        "commit": _commit(),
    }


def _processor() -> str:
    """Return the processor's name."""
    cpu_info = Path("/proc/cpuinfo")
    if cpu_info.exists():
        for line in cpu_info.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _commit() -> str:
    """Return the checked-out commit, marked where tracked files other than reports differ from it."""
    code = [f":(exclude){pattern}" for pattern in REPORTS]
    try:
        head = _git("rev-parse", "--short=12", "HEAD")
        changes = _git("status", "--porcelain", "--untracked-files=no", "--", ".", *code)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return f"{head} with local changes" if changes else head


def _git(*arguments: str) -> str:
    """Return the output of git in this repository."""
    command = ["git", "-C", str(ROOT), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()  # noqa: S603
