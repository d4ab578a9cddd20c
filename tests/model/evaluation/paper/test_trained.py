"""Experiments that train: variants that differ as they should, runs that resume, records, verdicts."""

import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from model import cli
from model.config import COMPARED_RUN, ON_CPU, DeviceOptions
from model.data.manifest import Manifest
from model.data.packed.cameras import CAMERAS
from model.data.packed.options import PackOptions
from model.data.packed.pack import pack
from model.evaluation.comparison import ORACLE, RETRIEVAL
from model.evaluation.paper.record import PaperRecord, Trial
from model.evaluation.paper.suites import PICTURED, SUITES, Claim
from model.evaluation.paper.trained import measure_suite
from model.evaluation.paper.training import configs, is_finished, run_folder, train_suite
from model.networks.decoders import make_network
from model.report.paper.trained import section, verdict
from model.training.device.data import load_data
from model.training.state import RunState
from tests.support.small import data as small_data
from tests.support.small.network import ENCODER

SMALL = replace(COMPARED_RUN, encoder=ENCODER, variants=False, late_from=1.0, batch=4, points=64, target_points=80)
FLAGS = ["--feature-maps", "4", "4", "4", "--convolutions", "1", "--fully-connected", "16", "--rank", "8"]
SIZES = ["--no-variants", "--late-from", "1", "--batch", "4", "--points", "32", "--target-points", "40"]


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six objects to train on, one to validate, two to test."""
    folder = small_data.write(tmp_path_factory.mktemp("suite") / "data", train=7, test=2)
    first, *others = Manifest.read(folder).entries
    Manifest(0, (replace(first, split="val"), *others), {}, {}).write(folder / "manifest.json")
    return folder


@pytest.mark.parametrize("name", list(SUITES))
def test_variants_of_a_suite_are_different_networks_of_one_setting(name: str) -> None:
    suite = SUITES[name]
    variants = configs(suite, SMALL, seed=3)
    assert len({str(config.to_dict()) for config in variants.values()}) == len(variants)
    shared = {each.name for each in fields(SMALL)} - {"spec", "method", "encoder", "seed"}
    shared -= {"projection": {"projection", "projection_form"}, "frame": {"frame"}}.get(name, set())
    for config in variants.values():
        assert config.seed == 3
        assert all(getattr(config, each) == getattr(SMALL, each) for each in shared)
    for claim in suite.claims:
        assert {claim.one, claim.other} <= variants.keys()
    assert suite.paper.keys() <= variants.keys()


def test_run_folder_of_the_same_network_in_several_suites_is_one() -> None:
    same = {
        "table1": "HOF-3",
        "architecture": "base, HOF-3",
        "domains": "ball",
        "projection": "none",
        "parts": "all of theta",
    }
    assert len({run_folder(Path(), configs(SUITES[name], SMALL, 0)[variant]) for name, variant in same.items()}) == 1
    folders = [run_folder(Path(), config) for suite in SUITES.values() for config in configs(suite, SMALL, 0).values()]
    assert len(set(folders)) == len(folders) - 5  # these, and the frame's: SMALL has no made pieces


@pytest.mark.slow
@pytest.mark.parametrize("name", ["architecture", "domains", "projection", "parts"])
def test_every_variant_of_a_suite_makes_a_network(name: str) -> None:
    for config in configs(SUITES[name], SMALL, seed=0).values():
        assert make_network(config).train()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["projection", "frame"])
def test_command_trains_measures_and_writes_the_page(name: str, data: Path, tmp_path: Path) -> None:
    command = ["paper", name, "--data", str(data), "--runs", str(tmp_path / "runs"), "-o", str(tmp_path)]
    command += ["--steps", "2", "--device", "cpu", *FLAGS, *SIZES]
    assert cli.main(command) == 0
    record = PaperRecord.read(tmp_path / "model" / "results" / "paper" / f"{name}.json")
    assert [trial.method for trial in record.trials] == list(SUITES[name].variants)
    for trial in record.trials:
        assert np.isfinite(trial.column("cd")).all()
        assert np.isfinite(trial.column("travel")).all()
    assert {about["steps"] for about in record.setting["variants"].values()} == {2}
    text = (tmp_path / "PAPER.md").read_text()
    assert f"## {SUITES[name].title}" in text
    assert "2 steps of 4 images" in " ".join(text.split())
    picture = tmp_path / "model" / "results" / "paper" / f"{name}.png"
    assert picture.is_file() == (name == PICTURED) == (f"{name}.png" in text)
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "runs").rglob("last.pt")}
    assert cli.main([*command, "--train-only"]) == 0  # finished runs are not trained again
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "runs").rglob("last.pt")} == before


@pytest.mark.slow
def test_measure_suite_with_references_measures_methods_that_are_not_trained(data: Path, tmp_path: Path) -> None:
    table1 = SUITES["table1"]
    alone = replace(table1, variants={"HOF-1": table1.variants["HOF-1"]})
    folders = train_suite("table1", alone, replace(SMALL, steps=1), [0], data, tmp_path, ON_CPU)
    assert folders is not None
    record = measure_suite("table1", folders, data, with_references=True)
    assert [trial.method for trial in record.trials] == ["HOF-1", RETRIEVAL, ORACLE]
    for trial in record.trials:
        assert np.isfinite(trial.column("cd")).all()


@pytest.mark.slow
def test_frame_from_shards_reads_their_cameras(data: Path, tmp_path: Path) -> None:
    packed = tmp_path / "packed"
    pack([data], packed, PackOptions(SMALL.framing, variants=False, made=False), processes=1)
    config = replace(SMALL, frame="camera")
    shards = load_data(Path("none"), config, DeviceOptions(device="cpu", packed=str(packed), workers=1)).train
    folder = load_data(data, config, DeviceOptions(device="cpu")).train
    assert shards.cameras is not None
    assert folder.cameras is not None
    assert shards.cameras.shape == (len(shards.images), 2)
    assert torch.equal(shards.cameras, folder.cameras)
    (packed / CAMERAS).unlink()
    with pytest.raises(FileNotFoundError, match="again, which adds it"):
        load_data(Path("none"), config, DeviceOptions(device="cpu", packed=str(packed), workers=1))


MISSING = ("scipy", "tqdm", "onnx", "onnxruntime", "trimesh", "pyvista", "pebble", "matplotlib", "skimage", "sklearn")


@pytest.mark.slow
def test_training_alone_needs_torch_numpy_and_pillow_alone(data: Path, tmp_path: Path) -> None:
    packed = tmp_path / "packed"
    pack([data], packed, PackOptions(SMALL.framing, variants=False, made=False), processes=1)
    flags = ["--packed", str(packed), "--workers", "1", "--runs", str(tmp_path / "runs"), "--train-only"]
    command = ["paper", "parts", "--steps", "1", "--device", "cpu", *flags, *FLAGS, *SIZES]
    hide = f"import sys; sys.modules.update(dict.fromkeys({MISSING!r}))"
    code = f"{hide}; from model.cli import main; sys.exit(main(sys.argv[1:]))"
    done = subprocess.run([sys.executable, "-c", code, *command], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert len(list((tmp_path / "runs").glob("*/last.pt"))) == 4


@pytest.mark.slow
def test_evaluate_refuses_a_run_in_the_cameras_frame(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    RunState(replace(SMALL, frame="camera")).save(tmp_path, 0.0)
    assert cli.main(["evaluate", "--run", str(tmp_path), "--data", str(data)]) == 2
    assert "`hof-model paper frame` measures such runs" in capsys.readouterr().err


@pytest.mark.slow
def test_suite_from_shards_stops_in_time_and_goes_on(data: Path, tmp_path: Path) -> None:
    packed, runs = tmp_path / "packed", tmp_path / "runs"
    pack([data], packed, PackOptions(SMALL.framing, variants=False, made=False), processes=1)
    options = DeviceOptions(device="cpu", packed=str(packed), workers=1)
    common = replace(SMALL, steps=3)
    suite = SUITES["projection"]
    short = replace(options, stop_after=1e-4)
    assert train_suite("projection", suite, common, [0], Path("none"), runs, short) is None
    first = next(iter(configs(suite, common, 0).values()))
    assert not is_finished(run_folder(runs, first))
    folders = train_suite("projection", suite, common, [0], Path("none"), runs, options)
    assert folders is not None
    assert list(folders) == [("none", 0), ("travel", 0), ("nearest", 0)]
    assert is_finished(run_folder(runs, first))
    assert not is_finished(run_folder(runs, replace(first, batch=2)))  # other options, another run


def _record(**columns: list[float]) -> PaperRecord:
    names = ("cd_forward", "cd_backward", "cd", "f@1%", "f@2%", "f@5%")
    trials = [Trial(name, {key: list(values) for key in names}) for name, values in columns.items()]
    about = {"parameters": 9, "predicted": 9, "layers": 2, "ms": 1.0, "steps": 100, "batch": 4, "trunk": "dense"}
    about |= {"size": 64, "augmented": False}
    variants = {name: {**about, "curve": [[50, 0.1], [80, 0.2], [100, 0.25]]} for name in columns}
    setting = {"split": "test", "objects": 4, "points": 10_000, "every_view": False, "seeds": [0], "variants": variants}
    origin = {"machine": "x", "date": "y", "commit": "z", "seed": 0}
    return PaperRecord("parts", setting, origin, list("abcd"), ["chair"] * 4, trials)


@pytest.mark.parametrize(
    ("one", "kind", "expected"),
    [
        ([0.9, 0.91, 0.9, 0.89], "lower", "holds, -0.1"),
        ([1.2, 1.21, 1.2, 1.19], "lower", "does not hold, +0.2"),
        ([0.5, 1.5, 0.6, 1.4], "lower", "undecided"),
        ([1.01, 1.0, 1.02, 1.0], "close", "holds, +0.0"),
        ([1.2, 1.21, 1.2, 1.19], "close", "does not hold, it is worse"),
        ([0.7, 0.71, 0.7, 0.69], "close", "better than that"),
        ([0.5, 1.5, 0.6, 1.4], "close", "undecided"),
    ],
)
def test_verdict_follows_the_interval_of_the_paired_difference(one: list[float], kind: str, expected: str) -> None:
    record = _record(a=one, b=[1.0, 1.0, 1.0, 1.0])
    assert verdict(record, Claim("", "a", "b", kind)).startswith(expected)  # type: ignore[arg-type]


def test_verdict_on_classes_counts_their_objects_alone() -> None:
    record = replace(_record(a=[1, 1, 3, 3], b=[2, 2, 2, 2]), classes=["cabinet", "cabinet", "chair", "chair"])
    assert verdict(record, Claim("", "a", "b", "lower", classes=("cabinet",))).startswith("holds, -1.000")
    assert verdict(record, Claim("", "a", "b", "lower", classes=("lamp",))).startswith("not measured")


def test_section_shows_setting_parameters_curves_and_claims() -> None:
    names = list(SUITES["parts"].variants)
    record = _record(**{name: [1.0 - 0.1 * index] * 4 for index, name in enumerate(names)})
    text = section(SUITES["parts"], record)
    assert "100 steps of 4 images of 64 pixels a side, not augmented" in text.replace("\n", " ")
    assert "| all of theta | - | 0.1000 | 0.1000 | 0.2500 | +0.0500 |" in text
    assert text.count("holds") == len(SUITES["parts"].claims)


def test_section_of_table_1_has_classes_and_methods_that_are_not_trained() -> None:
    names = list(SUITES["table1"].variants)
    record = _record(**{name: [1.0, 1.0, 1.0, 4.0] for name in [*names, "image retrieval"]})
    del record.setting["variants"]["image retrieval"]
    text = section(SUITES["table1"], replace(record, experiment="table1", classes=["chair", "chair", "chair", "sofa"]))
    cells = " | ".join(["2.500 (2.500 to 2.500)"] * 5)
    assert f"| HOF-1 | {cells} |" in text
    assert "| image retrieval | " in text
    assert text.count("| sofa | 1 | 4.000 |") == 2
    assert text.count("| **class-weighted** | 4 | 1.750 ") == 2
