"""Provenance names the commit, and says so if the code differs from it."""

import subprocess
from pathlib import Path

import pytest

from model import provenance as module


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make a repository with one commit, and let provenance take it for the project's."""
    monkeypatch.setattr(module, "ROOT", tmp_path)
    (tmp_path / "benchmarks").mkdir()
    for name in ("code.py", "REPORT.md", "benchmarks/load.json"):
        (tmp_path / name).write_text("1")
    identity = ["-c", "user.name=a", "-c", "user.email=a@example.org"]
    for arguments in (["init", "-q"], ["add", "."], [*identity, "commit", "-qm", "first"]):
        subprocess.run(["git", *arguments], cwd=tmp_path, check=True)
    return tmp_path


@pytest.mark.parametrize("name", ["REPORT.md", "benchmarks/load.json"])
def test_provenance_with_a_changed_report_names_the_commit_alone(repository: Path, name: str) -> None:
    (repository / name).write_text("2")
    assert "changes" not in str(module.provenance(0)["commit"])


def test_provenance_with_changed_code_says_so(repository: Path) -> None:
    (repository / "code.py").write_text("2")
    assert str(module.provenance(0)["commit"]).endswith(" with local changes")


def test_provenance_outside_a_repository_is_unknown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "ROOT", tmp_path)
    assert module.provenance(0)["commit"] == "unknown"
