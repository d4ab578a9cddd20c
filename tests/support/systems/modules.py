"""Modules in place of compiled ones."""

import sys
from types import ModuleType

import pytest


def replace_module(monkeypatch: pytest.MonkeyPatch, name: str, version: int | None) -> ModuleType:
    """Put an empty module in place of a compiled one, with a VERSION unless that is None; return it."""
    module = ModuleType(name)
    if version is not None:
        module.__dict__["VERSION"] = version
    monkeypatch.setitem(sys.modules, name, module)
    return module
