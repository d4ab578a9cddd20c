"""`make gpu-check`, as far as a CPU can run it."""

import subprocess
import sys
from pathlib import Path

import pytest
import torch

from model.training.device.check import parity
from model.training.device.check.parity import check_parity

pytestmark = pytest.mark.slow


def test_parity_holds_between_the_forms_that_run_on_the_cpu() -> None:
    table, holds = check_parity(torch.device("cpu"))
    assert holds, table
    assert table.count("\n") == 2 + 4 + 4 + 4


def test_parity_tells_where_a_limit_does_not_hold(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(parity, "LOSS_LIMIT", -1.0)
    assert not check_parity(torch.device("cpu"))[1]


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU: `make gpu-check` tests it")
def test_check_without_a_gpu_says_so_and_fails() -> None:
    root = Path(__file__).parents[4]
    command = [sys.executable, "-m", "model.training.device.check"]
    done = subprocess.run(command, cwd=root, capture_output=True, text=True)
    assert done.returncode == 1
    assert "sees no CUDA device; nothing was checked" in done.stderr
