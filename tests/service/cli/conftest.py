"""A working folder for the commands."""

from pathlib import Path

import pytest


@pytest.fixture
def here(tmp_path: Path, model_path: Path, photo: bytes, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a working folder with only photo.png in it; the tiny model is the default one."""
    folder = tmp_path / "here"
    folder.mkdir()
    (folder / "photo.png").write_bytes(photo)
    monkeypatch.chdir(folder)
    monkeypatch.setenv("HOF_MODEL", str(model_path))
    return folder
