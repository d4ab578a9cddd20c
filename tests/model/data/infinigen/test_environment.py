"""The environment of Infinigen, what its worker imports there, and the kinds that are asked of it."""

import ast
import shutil
import sys
from pathlib import Path

import pytest

from model.data.infinigen import environment, kinds
from model.data.infinigen.generate import worker_command


def test_kinds_are_distinct_and_drawn_by_their_shares() -> None:
    turns = sum(kind.share for kind in kinds.KINDS)
    drawn = [kinds.kind_of(number).name for number in range(2 * turns)]
    assert {kind.name: drawn.count(kind.name) for kind in kinds.KINDS} == {
        kind.name: 2 * kind.share for kind in kinds.KINDS
    }
    assert len({kind.name for kind in kinds.KINDS}) == len({kind.factory for kind in kinds.KINDS}) == len(kinds.KINDS)
    assert len(kinds.KINDS) >= 35


def test_worker_imports_nothing_that_its_environment_lacks() -> None:
    """It runs where this project is not installed."""
    tree = ast.parse(Path(worker_command(Path("python"))[-1]).read_text())
    imported = {name.name for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names}
    imported |= {str(node.module) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    packages = {name.split(".")[0] for name in imported} - set(sys.stdlib_module_names)
    assert packages == {"bpy", "infinigen", "numpy", "trimesh"}


def test_interpreter_installs_once_and_again_for_other_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    commands: list[list[str]] = []

    def record(command: list[str | Path]) -> None:
        commands.append([str(part) for part in command])
        (tmp_path / "bin").mkdir(exist_ok=True)
        (tmp_path / "bin" / "python").touch()

    monkeypatch.setattr(environment, "_run", record)
    python = environment.interpreter(tmp_path)
    assert [command[1:3] for command in commands] == [["-m", "venv"], ["-m", "pip"], ["-m", "pip"]]
    assert environment.interpreter(tmp_path) == python == tmp_path / "bin" / "python"
    assert len(commands) == 3
    monkeypatch.setattr(environment, "PACKAGES", (*environment.PACKAGES, "one-more==1"))
    environment.interpreter(tmp_path)
    assert commands[-1][-1] == "one-more==1"
    assert len(commands) == 6


def test_interpreter_without_python_3_11_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "version_info", (3, 14, 0))
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(FileNotFoundError, match=r"python3\.11 is not on the PATH"):
        environment.interpreter(tmp_path / "new")


def test_interpreter_failed_install_shows_what_pip_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    venv = tmp_path / "python"  # in place of a Python: its venv has the Python of these tests
    venv.write_text(f"#!/bin/sh\nmkdir -p $4/bin && ln -s {sys.executable} $4/bin/python\n")
    venv.chmod(0o755)
    monkeypatch.setattr(environment, "_python", lambda: str(venv))
    monkeypatch.setattr(environment, "ALONE", ("/no/such/package",))
    with pytest.raises(ChildProcessError, match="/no/such/package"):
        environment.interpreter(tmp_path / "new")
    assert not (tmp_path / "new" / environment.STAMP).exists()
