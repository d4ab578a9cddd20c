"""The JavaScript client as npm installs it, built once."""

from pathlib import Path
from typing import Protocol

import pytest

from tests.support.systems.javascript import build_package, run_in_package


class Run(Protocol):
    """Run a program of the package's folder; return what it wrote, or fail with it."""

    def __call__(self, *command: str, **environment: str) -> str: ...


@pytest.fixture(scope="session")
def npm() -> Run:
    """Return what runs a program of Node in the package's folder."""
    return run_in_package


@pytest.fixture(scope="session")
def built() -> Path:
    """Build the package and return its folder."""
    return build_package()
