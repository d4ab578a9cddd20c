"""Runtime over n, and interpolation: records, sections, verdicts."""

from pathlib import Path

import pytest

from model import cli
from model.evaluation.paper.record import PaperRecord, Trial
from model.evaluation.paper.runtime import configs, measure_runtime
from model.report.paper import interpolation, runtime

ROOT = Path(__file__).resolve().parents[4]


@pytest.mark.slow
def test_runtime_times_every_network_for_every_count() -> None:
    record = measure_runtime("cpu", counts=(50, 200))
    assert [trial.method for trial in record.trials] == list(configs())
    for trial in record.trials:
        assert (trial.column("50") > 0).all()
    decoder, hof = record.trial("DeepSDF"), record.trial("HOF-1")
    assert decoder.column("200").mean() > hof.column("200").mean()
    assert "| network | n = 50 | n = 200 |" in runtime.section(record)


@pytest.mark.parametrize(
    ("device", "ms", "expected"),
    [
        ("cpu", 90.0, "An almost 100-fold difference: does not hold"),
        ("cpu", 120.0, "An almost 100-fold difference: holds"),
        ("cuda", 2.0, "Times diverge from 1,000 points on: holds"),
        ("cuda", 1.0, "Times diverge from 1,000 points on: does not hold"),
    ],
)
def test_runtime_section_says_whether_the_claim_holds(device: str, ms: float, expected: str) -> None:
    trials = [Trial(name, {"1000": [value] * 3, "10000": [value] * 3}) for name, value in (("HOF-1", 1.0),)]
    trials += [Trial(name, {"1000": [ms] * 3, "10000": [ms] * 3}) for name in runtime.COMPARED]
    setting = {"device": device, "hardware": "h", "counts": [1000, 10000], "repeats": 3, "chunk": 10_000, "torch": "2"}
    origin = {"machine": "x", "date": "y", "commit": "z", "seed": 0}
    assert expected in runtime.section(PaperRecord("runtime", setting, origin, list("abc"), ["repeat"] * 3, trials))


def test_command_runtime_without_cuda_says_so(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    import torch

    if torch.cuda.is_available():
        pytest.skip("this machine has a GPU")
    assert cli.main(["paper", "runtime", "--device", "cuda", "-o", str(tmp_path)]) == 2
    assert "sees no CUDA device" in capsys.readouterr().err


def test_command_interpolation_writes_a_verdict_for_each_model(tmp_path: Path) -> None:
    (tmp_path / "model" / "results").mkdir(parents=True)
    (tmp_path / "model" / "results" / "mixtures").symlink_to(ROOT / "model" / "results" / "mixtures")
    assert cli.main(["paper", "interpolation", "-o", str(tmp_path)]) == 0
    text = (tmp_path / "PAPER.md").read_text()
    assert "## Interpolation" in text
    assert "- `hof1-k2`: does not hold, means lie nearer" in text
    record = PaperRecord.read(tmp_path / "model" / "results" / "paper" / "interpolation.json")
    assert interpolation.section(record) in text


def test_command_interpolation_without_mixtures_names_the_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["paper", "interpolation", "-o", str(tmp_path)]) == 2
    assert "run `hof-model mixtures` first" in capsys.readouterr().err
