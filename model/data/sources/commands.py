"""Programs that fetch packages, and folders that they fill whole or not at all."""

import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def run_command(command: list[str], folder: Path, advice: str) -> None:
    """Run a program in a folder. `advice`: what to do where it is missing.

    Raises
    ------
    FileNotFoundError : the program is missing, or it fails.
    """
    program = shutil.which(command[0])
    if program is None:
        raise FileNotFoundError(f"{command[0]} is missing: {advice}")
    result = subprocess.run([program, *command[1:]], cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603
    if result.returncode:
        raise FileNotFoundError(f"`{' '.join(command)}` failed: {result.stderr.strip()}")


@contextmanager
def whole_folder(target: Path) -> Iterator[Path]:
    """Make an empty folder beside `target`; it becomes `target` when the block ends without an error."""
    part = target.with_name(target.name + ".part")
    shutil.rmtree(part, ignore_errors=True)  # left by an interrupted run
    part.mkdir(parents=True)
    yield part
    part.rename(target)
