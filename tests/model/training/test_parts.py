"""Checkpoints whole and in parts."""

from pathlib import Path
from typing import Any

import pytest
import torch

from model.training import parts
from model.training.parts import has_checkpoint, load_checkpoint, save_checkpoint


def checkpoint(number: int) -> dict[str, Any]:
    return {"step": number, "network": {"weight": torch.full((4_000,), float(number))}}


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(parts, "PART_BYTES", 5_000)
    return tmp_path / "last.pt"


def test_checkpoint_in_parts_is_read_back_whole(path: Path) -> None:
    save_checkpoint(checkpoint(7), path, in_parts=True)
    *files, index = names(path.parent)
    assert index == "last.pt.parts"
    assert len(files) == 4
    assert all((path.parent / name).stat().st_size <= 5_000 for name in files)
    assert has_checkpoint(path)
    loaded = load_checkpoint(path)
    assert loaded["step"] == 7
    assert torch.equal(loaded["network"]["weight"], checkpoint(7)["network"]["weight"])


@pytest.mark.parametrize("forms", [(True, True), (True, False), (False, True)])
def test_later_checkpoint_replaces_an_earlier_one_of_any_form(forms: tuple[bool, bool], path: Path) -> None:
    first, second = forms
    save_checkpoint(checkpoint(1), path, in_parts=first)
    save_checkpoint(checkpoint(2), path, in_parts=second)
    assert load_checkpoint(path)["step"] == 2
    assert len(names(path.parent)) == (5 if second else 1)


def test_equal_checkpoints_in_parts_stay_whole(path: Path) -> None:
    for _ in range(2):
        save_checkpoint(checkpoint(1), path, in_parts=True)
    assert load_checkpoint(path)["step"] == 1


def test_missing_and_mixed_parts_are_refused(path: Path) -> None:
    assert not has_checkpoint(path)
    with pytest.raises(FileNotFoundError):
        load_checkpoint(path)
    save_checkpoint(checkpoint(1), path, in_parts=True)
    first, second, *_ = names(path.parent)
    (path.parent / first).write_bytes((path.parent / second).read_bytes())
    with pytest.raises(ValueError, match="do not fit together: copy them again"):
        load_checkpoint(path)
    (path.parent / second).unlink()
    with pytest.raises(FileNotFoundError):
        load_checkpoint(path)


def test_parts_stay_below_fifteen_megabytes() -> None:
    assert parts.PART_BYTES < 15_000_000
