"""`hof serve` as a process: what it says at start, and a user without a home folder."""

import json
import os
import shutil
from pathlib import Path

import httpx
import pytest

from service.api.routes.viewer import NOT_BUILT
from service.server.serve import NO_MATTING
from service.settings import SHIPPED_MATTING
from tests.support import ROOT
from tests.support.photos import disc, image_file
from tests.support.processes import USER_WITHOUT_HOME, hof_serve


def _messages(folder: Path) -> list[str]:
    return [json.loads(line)["message"] for line in (folder / "log").read_text().splitlines()]


def test_serve_without_matting_model_and_page_logs_both_and_their_remedies(tmp_path: Path, model_path: Path) -> None:
    tree = tmp_path / "tree"
    without_page = shutil.ignore_patterns("bundle", "node_modules", "__pycache__")
    shutil.copytree(ROOT / "service", tree / "service", ignore=without_page)
    with hof_serve(tmp_path, model_path, PYTHONPATH=str(tree)) as served:
        assert httpx.get(f"{served.url}/docs").status_code == 404
    messages = _messages(tmp_path)
    assert NO_MATTING in messages
    assert f"/ and /docs are missing: {NOT_BUILT}" in messages


def test_serve_with_all_parts_logs_nothing_missing(tmp_path: Path, model_path: Path) -> None:
    with hof_serve(tmp_path, model_path, HOF_MATTING_MODEL=str(SHIPPED_MATTING)) as served:
        assert httpx.get(f"{served.url}/docs").status_code == 200
    assert [message for message in _messages(tmp_path) if "matting" in message or "missing" in message] == []


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become a user without a passwd entry")
def test_serve_of_a_user_without_home_with_a_database_url_keeps_objects(tmp_path: Path, model_path: Path) -> None:
    with hof_serve(tmp_path, model_path, prefix=USER_WITHOUT_HOME) as served:
        stored = httpx.post(f"{served.url}/encode", content=image_file(disc()), timeout=60)
        assert stored.status_code == 201
        assert httpx.get(served.url + stored.json()["links"]["points"], timeout=60).status_code == 200
    assert (tmp_path / "hof.db").stat().st_uid == int(USER_WITHOUT_HOME[1].partition("=")[2])
    assert "Traceback" not in (tmp_path / "log").read_text()
    assert not Path("/~").exists()
