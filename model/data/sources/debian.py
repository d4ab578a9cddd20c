"""Download and unpack Debian packages below a folder, without installing them."""

import shutil
import subprocess
from pathlib import Path


def download(package: str, work: Path) -> Path:
    """Return the package's `.deb` in `work`; download it if it is missing.

    Raises
    ------
    FileNotFoundError : apt-get is missing or does not find the package.
    """
    work.mkdir(parents=True, exist_ok=True)
    if archives := sorted(work.glob(f"{package}_*.deb")):
        return archives[0]
    try:
        _run(["apt-get", "download", package], work)
    except FileNotFoundError:  # a fresh machine has no package lists yet; updating them needs root
        _run(["apt-get", "update"], work)
        _run(["apt-get", "download", package], work)
    return sorted(work.glob(f"{package}_*.deb"))[0]


def unpack(deb: Path, target: Path) -> None:
    """Unpack a `.deb` to the folder `target`, whole or not at all, unless the folder exists.

    Raises
    ------
    FileNotFoundError : dpkg-deb is missing, or the file is no package.
    """
    if target.is_dir():
        return
    part = target.with_name(target.name + ".part")
    shutil.rmtree(part, ignore_errors=True)  # left by an interrupted run
    part.mkdir(parents=True)
    _run(["dpkg-deb", "-x", str(deb.resolve()), str(part.resolve())], part)
    part.rename(target)


def _run(command: list[str], folder: Path) -> None:
    if shutil.which(command[0]) is None:
        raise FileNotFoundError(
            f"{command[0]} is missing: install it, or download the files elsewhere and pass their path"
        )
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603
    if result.returncode:
        raise FileNotFoundError(f"`{' '.join(command)}` failed: {result.stderr.strip()}")
