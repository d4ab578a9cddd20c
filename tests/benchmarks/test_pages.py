"""The benchmarks run and write their pages; what they measure is not tested."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.speed.networks import Network, deepsdf, foldingnet, mapping_network
from benchmarks.speed.rivals import RIVALS, Make, numpy_tiles
from benchmarks.speed.run import TANH
from service.mapping.spec import HOF_1, HOF_3, initial_theta, power
from tests.support import ROOT

RUN_TIMEOUT_S = 600
WAYS = {"NumPy tiles": numpy_tiles} | {name: RIVALS[name] for name in ("naive NumPy", "onnxruntime", "torch eager")}


def test_decoders_count_the_papers_parameters() -> None:
    assert deepsdf().parameters == 1_578_241
    assert foldingnet().parameters == 1_056_775
    assert mapping_network(HOF_1, initial_theta(HOF_1)).parameters == 7_171


@pytest.mark.parametrize("make", WAYS.values(), ids=WAYS)
@pytest.mark.parametrize(
    "network",
    [
        deepsdf(),
        foldingnet(),
        mapping_network(HOF_3.with_k(2), initial_theta(HOF_3)),
        mapping_network(TANH, initial_theta(TANH)),
    ],
    ids=lambda network: network.name,
)
def test_way_of_computing_equals_the_reference(make: Make, network: Network) -> None:
    x = np.random.default_rng(0).random((300, network.layers[0].w.shape[1]), np.float32)
    expected = network.reference(x)
    np.testing.assert_allclose(make(network, 128)(x), expected, atol=1e-5 * np.abs(expected).max())


def test_mapping_network_equals_the_power_of_the_mapping() -> None:
    spec = HOF_1.with_k(2)
    theta, x = initial_theta(spec), np.random.default_rng(0).random((10, 3), np.float32)
    np.testing.assert_allclose(mapping_network(spec, theta).reference(x), power(spec, theta, x), atol=1e-6)


@pytest.mark.server
@pytest.mark.parametrize(
    ("command", "row"),
    [("stages", "| box of the function |"), ("quantized", "| 8 bits, all layers, calibrated (QDQ) |")],
)
def test_speed_command_prints_its_table(command: str, row: str) -> None:
    line = [sys.executable, "-W", "ignore", "-m", f"benchmarks.speed.{command}", "--rounds", "1"]
    run = subprocess.run(line, capture_output=True, text=True, timeout=RUN_TIMEOUT_S, check=False, cwd=ROOT)
    assert run.returncode == 0, run.stderr
    assert row in run.stdout


@pytest.mark.server
def test_speed_run_quick_writes_its_tables(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchmarks.speed.run", "--quick", "--rounds", "1", "-o", str(tmp_path)]
    run = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=RUN_TIMEOUT_S,
        check=False,
        cwd=ROOT,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    assert (run.returncode, run.stderr) == (0, "")
    text = (tmp_path / "RESULTS.md").read_text()
    assert text == run.stdout
    for row in ("| ours |", "| ours, NumPy alone |", "| naive NumPy |", "| HOF-1, k = 2 |", "| DeepSDF |", "target"):
        assert row in text
    assert (tmp_path / "runtime.png").stat().st_size > 10_000


@pytest.mark.browser
def test_page_run_writes_its_table(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchmarks.page", "--rounds", "1", "-o", str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=RUN_TIMEOUT_S, check=False, cwd=ROOT)
    assert run.returncode == 0, run.stderr
    text = (tmp_path / "PAGE.md").read_text("utf-8")
    assert text == run.stdout
    for row in ("desktop: performance", "mobile: accessibility", "from a photo to its object"):
        assert row in text


@pytest.mark.system
def test_load_run_quick_writes_its_tables(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchmarks.load.run", "--quick", "-o", str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=RUN_TIMEOUT_S, check=False, cwd=ROOT)
    assert (run.returncode, run.stderr) == (0, "")
    text = (tmp_path / "LOAD.md").read_text()
    for row in (
        "## Batching",
        "## Overload",
        "| bare FastAPI |",
        "| ours, a repeated photo |",
        "## Faults",
        "## Outages",
        "## Fuzzing",
    ):
        assert row in text


@pytest.mark.server
def test_soak_of_few_requests_writes_its_page(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "benchmarks.load.soak", "--requests", "200", "-o", str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=RUN_TIMEOUT_S, check=False, cwd=ROOT)
    assert (run.returncode, run.stderr) == (0, "")
    text = (tmp_path / "SOAK.md").read_text()
    assert "# Soak: 200 mixed requests" in text
    assert "| answers of 5xx | 0.00 | <= 0 | yes |" in text


@pytest.mark.system
def test_replicas_of_few_operations_write_their_page(tmp_path: Path) -> None:
    options = ["--operations", "60", "--kills", "1", "--sizes", "1", "--seconds", "0.5", "-o", str(tmp_path)]
    command = [sys.executable, "-m", "benchmarks.load.replicas", *options]
    run = subprocess.run(command, capture_output=True, text=True, timeout=RUN_TIMEOUT_S, check=False, cwd=ROOT)
    assert (run.returncode, run.stderr) == (0, ""), run.stdout
    text = (tmp_path / "REPLICAS.md").read_text()
    assert "| 4 replicas, PostgreSQL through PgBouncer: lost, doubled or wrong | 0.00 | <= 0 | yes |" in text
    assert "| 4 workers, SQLite: lost, doubled or wrong | 0.00 | <= 0 | yes |" in text
    assert text.count("| `POST /encode`, new photos of 512 x 512 | 1 |") == 1


@pytest.mark.slow
def test_bulk_run_of_few_photos_prints_its_page() -> None:
    command = [sys.executable, "-m", "benchmarks.speed.bulk", "--photos", "40"]
    run = subprocess.run(command, capture_output=True, text=True, timeout=RUN_TIMEOUT_S, check=False, cwd=ROOT)
    assert (run.returncode, run.stderr) == (0, "")
    assert "| growth of resident memory after the first fifth, % |" in run.stdout
    assert run.stdout.count("\n| ") == 20 + 3
