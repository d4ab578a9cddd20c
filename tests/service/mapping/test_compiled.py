"""The compiled kernel, where another build of it lies beside the Python files."""

import sys
from collections.abc import Iterator
from types import ModuleType

import pytest

from service.mapping import compiled


@pytest.fixture(autouse=True)
def fresh() -> Iterator[None]:
    """Let each test, and what comes after it, load the kernel anew."""
    compiled.load.cache_clear()
    yield
    compiled.load.cache_clear()


@pytest.mark.parametrize("version", [None, compiled.VERSION - 1, compiled.VERSION + 1])
def test_load_of_a_kernel_of_another_version_gives_none(version: int | None, monkeypatch: pytest.MonkeyPatch) -> None:
    kernel = ModuleType(compiled.NAME)
    if version is not None:
        kernel.__dict__["VERSION"] = version
    monkeypatch.setitem(sys.modules, compiled.NAME, kernel)
    assert compiled.load() is None


def test_load_of_a_kernel_of_this_version_gives_it(monkeypatch: pytest.MonkeyPatch) -> None:
    kernel = ModuleType(compiled.NAME)
    kernel.__dict__["VERSION"] = compiled.VERSION
    monkeypatch.setitem(sys.modules, compiled.NAME, kernel)
    assert compiled.load() is kernel
