"""Files out of Debian's packages: downloaded and unpacked below a folder, never installed."""

import shutil
import subprocess
from pathlib import Path


def download(package: str, work: Path) -> Path:
    """The package's `.deb` in `work`, downloaded unless it is there.

    Raises
    ------
    FileNotFoundError : apt-get is missing or does not find the package.
    """
    work.mkdir(parents=True, exist_ok=True)
    if found := sorted(work.glob(f"{package}_*.deb")):
        return found[0]
    try:
        _run(["apt-get", "download", package], work)
    except FileNotFoundError:  # a fresh machine has no package lists yet; only root may get them
        _run(["apt-get", "update"], work)
        _run(["apt-get", "download", package], work)
    return sorted(work.glob(f"{package}_*.deb"))[0]


def unpack(deb: Path, target: Path) -> None:
    """Unpack a `.deb` as `target`, whole or not at all, unless it is there.

    Raises
    ------
    FileNotFoundError : dpkg-deb is missing, or the file is no package.
    """
    if target.is_dir():
        return
    part = target.with_name(target.name + ".part")
    shutil.rmtree(part, ignore_errors=True)  # of one that was stopped
    part.mkdir(parents=True)
    _run(["dpkg-deb", "-x", str(deb.resolve()), str(part.resolve())], part)
    part.rename(target)


def _run(command: list[str], folder: Path) -> None:
    if shutil.which(command[0]) is None:
        raise FileNotFoundError(f"{command[0]} is missing: on another system, pass the files by hand")
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603
    if done.returncode:
        raise FileNotFoundError(f"`{' '.join(command)}` failed: {done.stderr.strip()}")
