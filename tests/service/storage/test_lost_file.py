"""A SQLite file that is deleted or replaced while the service runs: nothing is confirmed that is not on disk."""

import os
import shutil
import sqlite3
import stat
from collections.abc import Callable
from pathlib import Path

import httpx
import pytest

from service.formats.weights import Weights, dump
from service.mapping.spec import HOF_1, initial_theta
from tests.support.processes import hof_serve

SPEC = HOF_1.with_k(2)


def _post(client: httpx.Client, seed: int) -> httpx.Response:
    return client.post("/objects", content=dump(Weights(SPEC, initial_theta(SPEC, seed), "m"), "safetensors"))


def _delete(file: Path) -> None:
    file.unlink()


def _replace(file: Path) -> None:
    copy = file.with_name("copy")
    shutil.copy(file, copy)
    os.replace(copy, file)


def _delete_log(file: Path) -> None:
    Path(f"{file}-wal").unlink()


def _delete_folder(file: Path) -> None:
    shutil.rmtree(file.parent)


@pytest.mark.parametrize("lose", [_delete, _replace, _delete_log, _delete_folder])
def test_put_after_the_file_is_lost_is_503_and_a_restart_heals(
    lose: Callable[[Path], None], tmp_path: Path, model_path: Path
) -> None:
    file = tmp_path / "store" / "hof.db"
    url = f"--database-url=sqlite:///{file}"
    with (
        hof_serve(tmp_path, model_path, url) as served,
        httpx.Client(base_url=served.url, timeout=60) as client,
    ):
        assert _post(client, 1).status_code == 201
        lose(file)
        for seed in range(2, 5):
            answer = _post(client, seed)
            assert (answer.status_code, answer.json()["title"]) == (503, "Store unavailable")
            assert "was deleted or replaced" in answer.json()["detail"]
            assert int(answer.headers["retry-after"]) >= 1
        assert client.get("/health/ready").status_code == 503
        assert client.get("/health/live").status_code == 200
    assert "Traceback" not in (tmp_path / "log").read_text()
    with (
        hof_serve(tmp_path, model_path, url) as served,
        httpx.Client(base_url=served.url, timeout=60) as client,
    ):
        assert _post(client, 9).status_code == 201


def test_put_after_the_file_is_put_back_works_again(tmp_path: Path, model_path: Path) -> None:
    file = tmp_path / "hof.db"
    with (
        hof_serve(tmp_path, model_path) as served,
        httpx.Client(base_url=served.url, timeout=60) as client,
    ):
        assert _post(client, 1).status_code == 201
        file.rename(tmp_path / "away")
        assert _post(client, 2).status_code == 503
        (tmp_path / "away").rename(file)
        assert _post(client, 3).status_code == 201
        assert client.get("/health/ready").status_code == 200
    with sqlite3.connect(file) as connection:
        assert connection.execute("SELECT count(*) FROM objects").fetchone() == (3,)
    connection.close()


def test_new_file_is_readable_by_its_owner_alone(tmp_path: Path, model_path: Path) -> None:
    with hof_serve(tmp_path, model_path) as served:
        assert httpx.get(f"{served.url}/objects", timeout=60).status_code == 200
        for suffix in ("", "-wal", "-shm"):
            assert stat.S_IMODE((tmp_path / f"hof.db{suffix}").stat().st_mode) == 0o600
