"""Download and unpack Debian packages below a folder, without installing them."""

from pathlib import Path
from typing import Final

from model.data.sources.commands import run_command, whole_folder

ADVICE: Final = "install it, or download the files elsewhere and pass their path"


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
        run_command(["apt-get", "download", package], work, ADVICE)
    except FileNotFoundError:  # a fresh machine has no package lists yet; updating them needs root
        run_command(["apt-get", "update"], work, ADVICE)
        run_command(["apt-get", "download", package], work, ADVICE)
    return sorted(work.glob(f"{package}_*.deb"))[0]


def unpack(deb: Path, target: Path) -> None:
    """Unpack a `.deb` to the folder `target`, whole or not at all, unless the folder exists.

    Raises
    ------
    FileNotFoundError : dpkg-deb is missing, or the file is no package.
    """
    if target.is_dir():
        return
    with whole_folder(target) as part:
        run_command(["dpkg-deb", "-x", str(deb.resolve()), str(part.resolve())], part, ADVICE)
