"""`hof-model` without the input of a stage."""

from pathlib import Path

import pytest

from model import cli


@pytest.fixture
def _in_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("_in_empty_folder")
@pytest.mark.parametrize("stage", ["train", "evaluate", "results", "export", "data preview"])
def test_stage_without_its_input_fails_with_one_line(stage: str, capsys: pytest.CaptureFixture[str]) -> None:
    missing = ["--model", "none.onnx"] if stage in ("evaluate", "results") else []
    assert cli.main([*stage.split(), *missing]) == 2
    message = capsys.readouterr().err
    assert message.startswith("hof-model: ")
    assert len(message.splitlines()) == 1
