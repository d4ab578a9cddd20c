"""The code in the JavaScript client's document runs, in order, against the service with the shipped models."""

import re
import shutil
from pathlib import Path

import pytest

from service.settings import Settings
from tests.client.js.conftest import Run
from tests.project.documents import ROOT, code, rows, section, text_of
from tests.support.server import running

pytestmark = pytest.mark.system

DOCUMENT = "docs/client-js.md"


def test_code_of_the_document_runs_in_order(npm: Run, built: Path, tmp_path: Path) -> None:
    shutil.copytree(ROOT / "demo", tmp_path / "demo")
    npm("npm", "install", "--offline", "--no-audit", "--no-fund", "--prefix", str(tmp_path), str(built))
    script = "\n".join(re.findall(r"^```js\n(.*?)^```", text_of(DOCUMENT), re.MULTILINE | re.DOTALL))
    with running(Settings(database_url=f"sqlite:///{tmp_path / 'hof.db'}", threads=1)) as server:
        file = tmp_path / "document.mjs"
        file.write_text(script.replace("localhost:8080", f"127.0.0.1:{server.port}"))
        lines = npm("sh", "-c", f"cd {tmp_path} && node document.mjs").splitlines()
    comments = re.findall(r"console\.log\(.*\); // (.+)$", script, re.MULTILINE)
    assert len(comments) >= 4
    assert [comment for comment in comments if comment not in lines] == []
    written = re.findall(r'writeFile\("(.+?)"', script)
    assert len(written) == 2
    assert [name for name in written if not (tmp_path / name).stat().st_size] == []


def test_table_of_methods_is_that_of_the_client(npm: Run, built: Path) -> None:
    listing = (
        'import { Client } from "hof-client"; console.log(Object.getOwnPropertyNames(Client.prototype).join(" "));'
    )
    methods = set(npm("node", "--input-type=module", "--eval", listing).split()) - {"constructor"}
    named = {name.partition("(")[0] for cells in rows(section(text_of(DOCUMENT), "Calls")) for name in code(cells[0])}
    assert named == methods
