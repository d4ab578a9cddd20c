"""The JavaScript client as npm installs it, built once."""

import fcntl
import os
import shutil
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol

import pytest

from tests.support import ROOT

PACKAGE = ROOT / "client" / "js"
FUNCTION = ROOT / "service" / "viewer" / "static" / "js" / "function"  # the package shares it with the page
TIMEOUT_S = 300


class Run(Protocol):
    """Run a program of the package's folder; return what it wrote, or fail with it."""

    def __call__(self, *command: str, **environment: str) -> str: ...


@pytest.fixture(scope="session")
def npm() -> Run:
    """Return what runs a program of Node in the package's folder."""
    assert shutil.which("node"), "Node is not installed: tests/support/system.sh installs it"
    modules = PACKAGE / "node_modules"
    assert modules.is_dir(), "the packages are not installed: run `npm ci --prefix client/js`"

    def run(*command: str, **environment: str) -> str:
        return _output(command, {"PATH": f"{modules / '.bin'}:{os.environ['PATH']}", **environment})

    return run


@pytest.fixture(scope="session")
def built(npm: Run) -> Path:
    """Build the package and return its folder."""
    dist = PACKAGE / "dist" / "index.js"
    sources = [
        *(PACKAGE / "src").rglob("*.*"),
        *FUNCTION.iterdir(),
        PACKAGE / "tsconfig.json",
        PACKAGE / "package.json",
    ]
    with (PACKAGE / "node_modules" / ".build.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # other workers of pytest build it, too
        if not dist.exists() or dist.stat().st_mtime < max(source.stat().st_mtime for source in sources):
            shutil.rmtree(dist.parent, ignore_errors=True)
            npm("tsc")
    return PACKAGE


def _output(command: tuple[str, ...], environment: Mapping[str, str]) -> str:
    run = subprocess.run(
        command,
        cwd=PACKAGE,
        env=os.environ | environment,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout
