"""Schemathesis asks a real server what openapi.json allows and what it does not, and checks every answer.

All its checks, in all its phases: limits, random requests, and calls that follow from each other. More of it, by hand,
against `hof serve` with the tiny model: `SCHEMATHESIS_HOOKS=schema_hooks st run URL/openapi.json --checks all -n 500`.
"""

import os
import subprocess
import sys
from pathlib import Path

import httpx

from tests.support import ROOT
from tests.support.processes import hof_serve

EXAMPLES, SEED = 15, 1
RUN_TIMEOUT_S = 580


def test_service_under_schemathesis_conforms_to_its_schema(model_path: Path, tmp_path: Path) -> None:
    command = [str(Path(sys.executable).with_name("st")), "run", "--checks", "all", "--continue-on-failure"]
    limits = ["--max-examples", str(EXAMPLES), "--seed", str(SEED), "--no-shrink"]
    with hof_serve(tmp_path, model_path, "--log-level", "info") as (url, process):
        run = subprocess.run(
            [*command, *limits, f"{url}/openapi.json"],
            cwd=tmp_path,
            env={**os.environ, "PYTHONPATH": str(ROOT), "SCHEMATHESIS_HOOKS": "tests.support.schema_hooks"},
            capture_output=True,
            text=True,
            timeout=RUN_TIMEOUT_S,
            check=False,
        )
        assert run.returncode == 0, run.stdout + run.stderr
        count = sum(len(calls) for calls in httpx.get(f"{url}/openapi.json").json()["paths"].values())
        assert f"{count} selected / {count} total" in run.stdout
        for phase in ("Coverage", "Fuzzing"):  # every call, by its limits and at random
            assert run.stdout.partition(f"{phase} (in ")[2].partition(" passed")[0].split()[-1] == str(count), (
                run.stdout
            )
        assert "Stateful" in run.stdout
        assert process.poll() is None
        figures = httpx.get(f"{url}/metrics").text
    for route in (
        "/encode",
        "/compose",
        "/objects",
        "/objects/{id}/points",
        "/objects/{id}/mesh",
        "/objects/{id}/picture",
        "/objects/{id}/path",
    ):
        assert any(f'route="{route}"' in line and 'status="20' in line for line in figures.splitlines()), (
            f"no valid call of {route} was among them"
        )
    assert 'status="500"' not in figures
