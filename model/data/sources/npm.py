"""Download and unpack packages of npm's registry below a folder, without installing them."""

import shutil
import subprocess
import tarfile
from pathlib import Path


def unpack_package(package: str, work: Path) -> Path:
    """Return the folder of a package, `name@version`; download and unpack it below `work` if it is missing.

    Raises
    ------
    FileNotFoundError : npm is missing or does not find the package.
    """
    target = work / package
    if target.is_dir():
        return target / "package"
    part = work / f"{package}.part"
    shutil.rmtree(part, ignore_errors=True)  # left by an interrupted run
    part.mkdir(parents=True)
    with tarfile.open(_download(package, part)) as archive:
        archive.extractall(part, filter="data")
    part.rename(target)
    return target / "package"


def _download(package: str, folder: Path) -> Path:
    npm = shutil.which("npm")
    if npm is None:
        raise FileNotFoundError("npm is missing: install Node.js, which brings it")
    command = [npm, "pack", "--loglevel=error", package]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603
    if result.returncode:
        raise FileNotFoundError(f"`npm pack {package}` failed: {result.stderr.strip()}")
    return next(folder.glob("*.tgz"))
