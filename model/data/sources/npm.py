"""Download and unpack packages of npm's registry below a folder, without installing them."""

import tarfile
from pathlib import Path

from model.data.sources.commands import run_command, whole_folder


def unpack_package(package: str, work: Path) -> Path:
    """Return the folder of a package, `name@version`; download and unpack it below `work` if it is missing.

    Raises
    ------
    FileNotFoundError : npm is missing or does not find the package.
    """
    target = work / package
    if not target.is_dir():
        with whole_folder(target) as part:
            run_command(["npm", "pack", package], part, "install Node.js, which brings it")
            with tarfile.open(next(part.glob("*.tgz"))) as archive:
                archive.extractall(part, filter="data")
    return target / "package"
