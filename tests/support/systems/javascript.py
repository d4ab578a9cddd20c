"""The JavaScript client as npm installs it, built once for all tests."""

import fcntl
import os
import shutil
import subprocess
from pathlib import Path
from typing import Final

from tests.support import ROOT

PACKAGE: Final = ROOT / "client" / "js"
MODULES: Final = PACKAGE / "node_modules"
FUNCTION: Final = ROOT / "service" / "viewer" / "static" / "js" / "function"  # the package shares it with the page
TIMEOUT_S: Final = 300


def run_in_package(*command: str, **environment: str) -> str:
    """Run a program of Node in the package's folder; return what it wrote, or fail with it."""
    assert shutil.which("node"), "Node is not installed: tests/support/system.sh installs it"
    assert MODULES.is_dir(), "the packages are not installed: run `npm ci --prefix client/js`"
    run = subprocess.run(
        command,
        cwd=PACKAGE,
        env={**os.environ, "PATH": f"{MODULES / '.bin'}:{os.environ['PATH']}", **environment},
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout


def build_package() -> Path:
    """Build the package, unless it is newer than its sources, and return its folder."""
    dist = PACKAGE / "dist" / "index.js"
    sources = [
        *(PACKAGE / "src").rglob("*.*"),
        *FUNCTION.iterdir(),
        PACKAGE / "tsconfig.json",
        PACKAGE / "package.json",
    ]
    with (MODULES / ".build.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # other workers of pytest build it, too
        if not dist.exists() or dist.stat().st_mtime < max(source.stat().st_mtime for source in sources):
            shutil.rmtree(dist.parent, ignore_errors=True)
            run_in_package("tsc")
    return PACKAGE
