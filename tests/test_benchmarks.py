"""The benchmarks run and write what they promise; what they measure is nothing to test."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
RUN_TIMEOUT_S = 120


def test_sampler_benchmark_writes_its_table(tmp_path: Path) -> None:
    output = tmp_path / "RESULTS.md"
    command = [str(ROOT / "benchmarks" / "sampler.py"), "--pairs", "1", "--points", "1000", "-o", str(output)]
    run = subprocess.run([sys.executable, *command], capture_output=True, text=True, timeout=RUN_TIMEOUT_S, check=False)
    assert (run.returncode, run.stderr) == (0, "")
    text = output.read_text()
    assert text == run.stdout
    rows = [[cell.strip() for cell in line.split("|")[1:3]] for line in text.splitlines() if line.startswith("| HOF")]
    assert rows == [["HOF-1", "1"], ["HOF-1", "2"], ["HOF-3", "1"]]
