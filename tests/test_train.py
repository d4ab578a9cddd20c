"""One tiny run, from meshes to an exported encoder: training, resuming, export, evaluation, report."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from shapes import write_folder

from model import cli
from model.config import EncoderConfig, TrainConfig
from model.data.build import build
from model.data.meshes import folder_records
from model.evaluate import evaluate, predict
from model.export import TOLERANCE, export, parity
from model.report import report, table
from model.train import load_encoder, train
from service.encoder import Encoder
from service.images import Framing
from service.mapping import MappingSpec

CONFIG = TrainConfig(
    spec=MappingSpec("small", 3, (32,), 3, k=2),
    encoder=EncoderConfig(feature_maps=(4, 4, 4), convolutions=1, fully_connected=(32,), rank=8),
    framing=Framing(size=32),
    batch=8,
    points=128,
    target_points=200,
    learning_rate=3e-3,
    minutes=0.1,
)


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("training")
    build(folder_records(write_folder(folder / "meshes"), "CC0"), folder / "data", seed=0, processes=2)
    return folder / "data"


@pytest.fixture(scope="session")
def run(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return train(data, tmp_path_factory.mktemp("run"), CONFIG).parent


@pytest.fixture(scope="session")
def exported(run: Path, data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("weights") / "small-k2.onnx"
    assert cli.main(["export", "--run", str(run), "--data", str(data), "-o", str(output)]) == 0
    return output


def records(run: Path) -> list[dict[str, float]]:
    return [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]


def test_training_lowers_the_loss_and_keeps_its_config(run: Path) -> None:
    losses = [record["loss"] for record in records(run) if "loss" in record]
    assert losses[-1] < 0.5 * losses[0]
    _, config, state = load_encoder(run / "last.pt")
    assert config == CONFIG
    assert state["step"] == records(run)[-1]["step"]


def test_a_resumed_run_goes_on_where_it_stopped(run: Path, data: Path, tmp_path: Path) -> None:
    saved = torch.load(run / "last.pt", weights_only=True)
    saved["config"]["minutes"] = 0.15
    torch.save(saved, tmp_path / "last.pt")
    train(data, tmp_path, TrainConfig(seed=99))  # the stored config counts, not this one
    _, config, state = load_encoder(tmp_path / "last.pt")
    assert config.seed == CONFIG.seed
    assert state["step"] > saved["step"]
    assert state["elapsed_s"] >= 9
    assert records(tmp_path)[0]["step"] > saved["step"]


def test_a_finished_run_is_left_alone(run: Path, data: Path) -> None:
    before = (run / "last.pt").read_bytes()
    train(data, run, CONFIG)
    assert (run / "last.pt").read_bytes() == before


@pytest.mark.parametrize(
    "spec",
    [
        MappingSpec("hof3", 3, (16, 16, 16), 3, k=1),
        MappingSpec("tanh", 3, (16,), 3, "tanh", 4, "cube"),
        MappingSpec("four", 4, (16,), 3, k=1, domain="ball4"),
    ],
    ids=lambda spec: spec.name,
)
@pytest.mark.parametrize("rank", [0, 8])
def test_every_configuration_exports_with_parity(spec: MappingSpec, rank: int, tmp_path: Path) -> None:
    from dataclasses import replace

    from model.networks import ImageEncoder

    config = replace(CONFIG, spec=spec, encoder=replace(CONFIG.encoder, rank=rank))
    encoder = ImageEncoder(spec, config.encoder, config.framing.size).eval()
    differences = export(encoder, config, {"name": "x"}, tmp_path / "x.onnx")
    assert max(differences.values()) < TOLERANCE
    assert Encoder.open(tmp_path / "x.onnx", 1).spec == spec


def test_export_refuses_a_file_that_disagrees(run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from model import export as module

    encoder, config, _ = load_encoder(run / "last.pt")
    monkeypatch.setattr(module, "TOLERANCE", 0.0)
    with pytest.raises(ValueError, match="disagree"):
        export(encoder, config, {"name": "x"}, tmp_path / "x.onnx")
    assert not list(tmp_path.iterdir())


def test_the_exported_file_describes_itself(exported: Path) -> None:
    encoder = Encoder.open(exported, 1)
    assert (encoder.name, encoder.spec, encoder.framing) == ("small-k2", CONFIG.spec, CONFIG.framing)
    assert encoder.card["training"]["steps"] > 0
    assert set(encoder.card["figures"]) == {"small-k2", "mean shape", "random training shape"}
    page = (exported.parent / "README.md").read_text()
    assert "mean shape" in page
    assert f"{exported.stat().st_size:,} bytes" in page


def test_matrices_are_stored_in_half_the_bytes(exported: Path, run: Path) -> None:
    encoder, config, _ = load_encoder(run / "last.pt")
    numbers = sum(p.numel() for p in encoder.parameters() if p.dim() > 1)
    assert exported.stat().st_size < 2.2 * numbers + 20_000 + 16 * config.spec.size
    assert max(parity(encoder, config, Encoder.open(exported, 1)).values()) > 0  # unrounded weights do differ


def test_evaluation_follows_the_bytes_and_reports(exported: Path, data: Path, tmp_path: Path) -> None:
    encoder = Encoder.open(exported, 1)
    evaluations = report(encoder, data, "test", tmp_path)
    assert [found.method for found in evaluations] == ["small-k2", "mean shape", "random training shape"]
    again = evaluate(encoder, data, "test")
    assert [found.values for found in again] == [found.values for found in evaluations]
    results = (tmp_path / "RESULTS.md").read_text()
    assert table(evaluations) in results
    raw = json.loads((tmp_path / "model/results/small-k2.json").read_text())
    assert raw["objects"]["small-k2"] == evaluations[0].values
    with Image.open(tmp_path / "model/results/small-k2.png") as sheet:
        assert sheet.width == 2 * 3 * 160


def test_a_prediction_is_what_the_service_would_answer(exported: Path) -> None:
    encoder = Encoder.open(exported, 1)
    view = np.zeros((64, 64, 4), np.uint8)
    view[20:40, 10:50] = [10, 200, 30, 255]
    points = predict(encoder, view, 500)
    assert points.shape == (500, 3)
    moved = np.roll(view, (5, 3), axis=(0, 1))
    assert predict(encoder, moved, 500) == pytest.approx(points)  # framing undoes a shift


@pytest.fixture
def _in_empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


@pytest.mark.usefixtures("_in_empty_folder")
@pytest.mark.parametrize("stage", ["train", "evaluate", "results", "export", "data preview"])
def test_a_stage_without_its_input_says_so(stage: str, capsys: pytest.CaptureFixture[str]) -> None:
    missing = ["--model", "none.onnx"] if stage in ("evaluate", "results") else []
    assert cli.main([*stage.split(), *missing]) == 2
    message = capsys.readouterr().err
    assert message.startswith("hof-model: ")
    assert len(message.splitlines()) == 1
