"""`hof info` describes a weights file."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from service.cli.main import main
from service.formats.weights import dump, load


def test_info_of_a_weights_file_prints_model_spec_and_size(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["encode", "photo.png", "-o", "out.safetensors"])
    assert main(["info", "out.safetensors"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["model"], summary["spec"]["k"], summary["size"]) == ("tiny-k2", 2, 115)


def test_info_of_weights_in_fewer_bytes_prints_their_loss(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["encode", "photo.png", "-o", "out.safetensors"])
    small = replace(load((here / "out.safetensors").read_bytes()), dtype="int8")
    (here / "small.safetensors").write_bytes(dump(small, "safetensors"))
    capsys.readouterr()
    assert main(["info", "small.safetensors"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["dtype"] == "int8"
    assert 0 < summary["loss"]["mean"] <= summary["loss"]["largest"]
