"""The environment that Infinigen runs in: Python 3.11, numpy below 2, and bpy, which is GPL-3.0-or-later."""

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Final

ENVIRONMENT: Final = Path(".venv/infinigen")
VERSION: Final = (3, 11)  # the only one that bpy 4.2 and Infinigen run on
STAMP: Final = "packages.txt"  # in the environment: what was installed
ALONE: Final = ("infinigen==1.15.5", "bpy==4.2.0")  # installed without what they require: its pins exclude each other
PACKAGES: Final = (  # of what they require, all that the worker imports
    "geomdl==5.4.0",
    "gin-config==0.5.0",
    "imageio==2.38.1",
    "landlab==2.6.0",
    "matplotlib==3.11.2",
    "networkx==3.6.1",
    "numpy==1.26.4",
    "opencv-python-headless==4.8.1.78",
    "OpenEXR==3.5.3",
    "pandas==3.0.6",
    "psutil==7.2.2",
    "python-fcl==0.7.0.11",
    "rtree==1.4.1",
    "scikit-image==0.26.0",
    "scikit-learn==1.9.1",
    "scipy==1.17.1",
    "shapely==2.0.5",
    "tqdm==4.70.1",
    "trimesh==3.22.5",
)


def interpreter(environment: Path) -> Path:
    """Return the environment's Python; install the environment if it is missing, unfinished or of other packages.

    Raises
    ------
    FileNotFoundError : there is no Python 3.11.
    ChildProcessError : a package cannot be installed.
    """
    stamp, packages = environment / STAMP, "\n".join((*ALONE, *PACKAGES, ""))
    python = environment / "bin" / "python"
    if stamp.is_file() and stamp.read_text() == packages and python.exists():
        return python
    print(f"installing Infinigen and Blender into {environment}: 2.4 GB", file=sys.stderr)
    _run([_python(), "-m", "venv", "--clear", environment])
    install: list[str | Path] = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    _run([*install, "--no-deps", *ALONE])
    _run([*install, *PACKAGES])
    stamp.write_text(packages)
    return python


def _python() -> str:
    """Return a Python of VERSION."""
    if sys.version_info[:2] == VERSION:
        return sys.executable
    name = f"python{VERSION[0]}.{VERSION[1]}"
    if path := shutil.which(name):
        return path
    raise FileNotFoundError(f"{name} is not on the PATH: install it, bpy 4.2 and Infinigen run on no other")


def _run(command: list[str | Path]) -> None:
    result = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - pip and venv
    if result.returncode:
        raise ChildProcessError(f"{' '.join(map(str, command[:4]))} failed: {result.stderr.strip()}")
