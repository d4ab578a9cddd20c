"""The Khronos glTF validator, run by Node; `npm ci` here installs it."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

_FOLDER = Path(__file__).parent
TIMEOUT_S = 60


def gltf_report(glb: bytes, folder: Path) -> dict[str, Any]:
    """Return the validator's report on a GLB file, which is written to `folder`; fail without Node or the package."""
    node = shutil.which("node")
    if node is None:
        pytest.fail("Node is not installed: the glTF tests run the Khronos validator with it")
    if not (_FOLDER / "node_modules" / "gltf-validator").is_dir():
        pytest.fail("the Khronos validator is not installed: run `npm ci --prefix tests/support/gltf`")
    path = folder / "validated.glb"
    path.write_bytes(glb)
    run = subprocess.run(
        [node, str(_FOLDER / "validate.mjs"), str(path)], capture_output=True, text=True, timeout=TIMEOUT_S, check=False
    )
    if run.returncode != 0:
        pytest.fail(f"the Khronos validator gave up: {run.stderr}")
    report: dict[str, Any] = json.loads(run.stdout)
    return report


def check_valid(glb: bytes, folder: Path) -> dict[str, Any]:
    """Check that a GLB file has neither errors nor warnings, and return the report."""
    report = gltf_report(glb, folder)
    issues = report["issues"]
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]
    return report
