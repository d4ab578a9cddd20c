"""Several worker processes: one service, one store, figures that add up."""

import json
import os
import signal
import time
from pathlib import Path

import httpx

from tests.support.photos import disc, image_file
from tests.support.processes import hof_serve

OBJECTS = 6


def _pids(folder: Path, text: str) -> set[int]:
    """Of the log's lines that hold a text, the processes."""
    whole = (folder / "log").read_text().rpartition("\n")[0].splitlines()
    return {json.loads(line)["pid"] for line in whole if text in line}


def _counted(url: str, route: str) -> float:
    """Requests of a route that any worker says were answered."""
    lines = httpx.get(f"{url}/metrics", timeout=60).text.splitlines()
    found = [line for line in lines if line.startswith("hof_http_requests_total{") and f'route="{route}"' in line]
    return sum(float(line.rsplit(" ", 1)[1]) for line in found)


def test_workers_share_store_and_figures(model_path: Path, tmp_path: Path) -> None:
    with hof_serve(tmp_path, model_path, "--workers", "2", HOF_LOG_FORMAT="json") as (url, _):
        while len(_pids(tmp_path, "startup complete")) < 2:
            time.sleep(0.05)
        asked = 0
        while len(_pids(tmp_path, '"route": "/model"')) < 2:  # a connection each: either may take it
            assert httpx.get(f"{url}/model", timeout=60).status_code == 200
            asked += 1
        for _ in range(10):
            assert _counted(url, "/model") == asked
        photos = [image_file(disc(size=(120 + index, 90))) for index in range(OBJECTS)]
        for photo in photos:
            assert httpx.post(f"{url}/encode", content=photo, timeout=60).status_code == 201
        for _ in range(10):
            assert len(httpx.get(f"{url}/objects", timeout=60).json()["items"]) == OBJECTS

        workers = _pids(tmp_path, "startup complete")
        os.kill(workers.pop(), signal.SIGKILL)
        while len(_pids(tmp_path, "startup complete")) < 3:
            time.sleep(0.05)
        assert _counted(url, "/model") == asked
        in_flight = [line for line in httpx.get(f"{url}/metrics").text.splitlines() if "in_flight " in line]
        assert in_flight[-1] == "hof_http_requests_in_flight 1.0"
    assert not list(Path(os.environ.get("TMPDIR", "/tmp")).glob(f"hof-metrics-*/*_{workers.pop()}.db"))
