"""The page's main path in Debian's Firefox, driven by Puppeteer over WebDriver BiDi."""

import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from service.settings import SHIPPED_MODEL, Settings
from tests.support.browsing import INK, PICTURES, photo
from tests.support.server import running

pytestmark = pytest.mark.browser

TOOLS = Path(__file__).parent / "tools"
TIMEOUT_S = 300


@pytest.fixture
def empty_address(tmp_path: Path) -> Iterator[str]:
    """Run a service without objects."""
    store = f"sqlite:///{tmp_path / 'hof.db'}"
    with running(Settings(model=(SHIPPED_MODEL,), database_url=store, matting_model=None, threads=1)) as server:
        yield f"http://127.0.0.1:{server.port}"


def _in_firefox(script: str, *arguments: str) -> str:
    """Run a script of `tools` with Firefox on a screen that nobody sees, and return its output."""
    node, firefox, screen = (shutil.which(name) for name in ("node", "firefox-esr", "xvfb-run"))
    assert node, "Node is not installed"
    assert firefox, "the page is tested in Debian's firefox-esr: tests/support/system.sh installs it"
    assert screen, "Firefox needs xvfb-run: tests/support/system.sh installs it"
    assert (TOOLS / "node_modules").is_dir(), f"run `npm ci --prefix {TOOLS}`"
    done = subprocess.run(
        [screen, "-a", "-s", "-screen 0 1280x1024x24", node, str(TOOLS / script), *arguments],
        env={**os.environ, "FIREFOX": firefox},
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_firefox_photo_is_drawn_downloaded_and_mixed(empty_address: str, tmp_path: Path) -> None:
    folder = tmp_path / "seen"
    folder.mkdir()
    report = json.loads(_in_firefox("firefox.mjs", f"{empty_address}/", str(photo("chair")), str(folder)))
    assert report["version"].startswith("firefox/")
    assert report["faults"] == []
    assert "transparency" in report["caption"]
    assert report["words"] == ["A", "AB", "BA", "B"]
    stage, empty = (
        np.asarray(Image.open(folder / f"firefox-{name}.png").convert("RGB").resize((300, 200))).astype(np.int16)
        for name in ("stage", "empty")
    )
    assert (abs(stage - empty).max(axis=2) > INK).sum() > 2000
    (glb,) = folder.glob("hof-*.glb")
    assert len(trimesh.load(glb).to_geometry().faces) > 10_000
    for name in ("firefox", "firefox-mix"):
        shutil.copy(folder / f"{name}.png", PICTURES)
