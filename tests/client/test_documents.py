"""The code in the client's documents runs, in order, against the service with the shipped models."""

import ast
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hof_client import Client
from service.settings import Settings
from tests.project.documents import ROOT, code, rows, section, text_of
from tests.support.server import running

DOCUMENTS = ("docs/client.md", "client/README.md")
SCRIPT_TIMEOUT_S = 120


def _blocks(document: str) -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", text_of(document), re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("document", DOCUMENTS)
def test_code_of_a_document_runs_in_order(document: str, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "demo", tmp_path / "demo")
    store = f"sqlite:///{tmp_path / 'hof.db'}"
    with running(Settings(database_url=store, threads=1)) as server:
        script = "\n".join(_blocks(document)).replace("localhost:8080", f"127.0.0.1:{server.port}")
        run = subprocess.run(
            [sys.executable, "-c", script],
            cwd=tmp_path,
            env=os.environ | {"PYTHONPATH": str(ROOT / "client" / "src")},
            capture_output=True,
            text=True,
            timeout=SCRIPT_TIMEOUT_S,
            check=False,
        )
    assert run.returncode == 0, run.stderr
    comments = re.findall(r"^ *print\(.*\)  # (.+)$", script, re.MULTILINE)
    assert [comment for comment in comments if comment not in run.stdout.splitlines()] == []
    written = re.findall(r'"(\w+\.(?:glb|stl))"', script)
    assert written
    assert [name for name in written if not (tmp_path / name).stat().st_size] == []


@pytest.mark.parametrize("document", DOCUMENTS)
def test_code_of_a_document_parses_as_one_module(document: str) -> None:
    assert ast.parse("\n".join(_blocks(document))).body


def test_table_of_calls_names_every_method() -> None:
    table = rows(section(text_of("docs/client.md"), "Calls"))
    named = {name for cells in table for cell in (cells[0], cells[2]) for name in code(cell)}
    methods = {name for name in vars(Client) if not name.startswith("_")}
    assert methods - named == {"send", "iterate", "close"}
    assert {name for cells in table for name in code(cells[0])} <= methods
