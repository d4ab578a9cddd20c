"""A full disk: answer 507, keep nothing of the call, and go on working. Real limits on real processes."""

import os
import resource
import shutil
import sqlite3
import subprocess
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from itertools import count
from pathlib import Path

import httpx
import pytest

from service.formats.weights import Weights, dump
from service.mapping.spec import HOF_1, initial_theta
from tests.support.processes import Served, hof_serve
from tests.support.systems.postgres import Postgres

SPEC = HOF_1.with_k(2)
NAMESPACE = ["unshare", "--mount"] if os.geteuid() == 0 else ["unshare", "--map-root-user", "--mount"]
MOUNT = 'mount -t tmpfs -o size=1m tmpfs "$0" && exec "$@"'
Grow = Callable[[], object]
Limit = Callable[[Path, Path], AbstractContextManager[tuple[Served, Path, Grow]]]


@contextmanager
def _small_file_system(folder: Path, model: Path) -> Iterator[tuple[Served, Path, Grow]]:
    """Run a service with its database on a file system of 1 MiB, half of it occupied; growing frees that half."""
    mount = [*NAMESPACE, "sh", "-c", MOUNT, str(folder)]
    with hof_serve(folder, model, prefix=mount) as served:
        root = Path(f"/proc/{served.process.pid}/root{folder}")
        ballast = root / "ballast"
        ballast.write_bytes(bytes(500_000))
        yield served, root / "hof.db", ballast.unlink


@contextmanager
def _file_size_limit(folder: Path, model: Path) -> Iterator[tuple[Served, Path, Grow]]:
    """Run a service whose files may not exceed 300 kB; growing lifts the limit."""
    unlimited = (resource.RLIM_INFINITY, resource.RLIM_INFINITY)
    with hof_serve(folder, model) as served:
        pid = served.process.pid
        resource.prlimit(pid, resource.RLIMIT_FSIZE, (300_000, resource.RLIM_INFINITY))
        yield served, folder / "hof.db", lambda: resource.prlimit(pid, resource.RLIMIT_FSIZE, unlimited)


def _may_mount() -> bool:
    """Return whether this machine lets us mount. Many containers do not; then only file sizes are limited."""
    return subprocess.run([*NAMESPACE, "true"], capture_output=True, check=False).returncode == 0


LIMITS = [_file_size_limit, *([_small_file_system] if _may_mount() else [])]


def _post(client: httpx.Client, seed: int) -> httpx.Response:
    return client.post("/objects", content=dump(Weights(SPEC, initial_theta(SPEC, seed), "m"), "safetensors"))


def _assert_full(answer: httpx.Response) -> None:
    assert (answer.status_code, answer.headers["content-type"]) == (507, "application/problem+json")
    assert answer.json()["type"] == "urn:hof:problem:insufficient-storage"


@pytest.mark.parametrize("limit", LIMITS)
def test_put_on_a_full_disk_is_507_and_the_service_goes_on(limit: Limit, tmp_path: Path, model_path: Path) -> None:
    with limit(tmp_path, model_path) as (served, database, grow):
        with httpx.Client(base_url=served.url, timeout=60) as client:
            kept = []
            for seed in count():
                answer = _post(client, seed)
                if answer.status_code != 201:
                    break
                kept.append(answer.json()["id"])
                assert seed < 100, "the disk does not get full"
            _assert_full(answer)
            assert len(kept) >= 2
            _assert_full(_post(client, 1000))
            assert client.get("/health/ready").status_code == 200
            listed = client.get("/objects", params={"limit": 500}).json()["items"]
            assert [item["id"] for item in reversed(listed)] == kept
            assert client.get(f"/objects/{kept[-1]}/points", params={"n": 10}).status_code == 200
            grow()
            again = _post(client, 1000)
            assert again.status_code == 201
            both = {"objects": [kept[0], again.json()["id"]], "mode": "all"}
            assert client.post("/compose", json=both).status_code == 201
        for suffix in ("", "-wal"):
            shutil.copy(f"{database}{suffix}", tmp_path / f"copy.db{suffix}")  # SQLite would not look into a namespace
        connection = sqlite3.connect(tmp_path / "copy.db")
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert connection.execute("SELECT count(*) FROM objects").fetchone() == (len(kept) + 1 + 4,)
        connection.close()


FULL = """
CREATE FUNCTION disk_full() RETURNS trigger LANGUAGE plpgsql AS
    $$BEGIN RAISE EXCEPTION 'could not extend file' USING ERRCODE = 'disk_full'; END$$;
CREATE TRIGGER disk_full BEFORE INSERT ON uses EXECUTE FUNCTION disk_full();
"""


@pytest.mark.parametrize("database_url", ["postgresql"], indirect=True)
def test_compose_on_postgresqls_full_disk_is_507_and_keeps_no_word(
    database_url: str, postgres: Postgres, client: httpx.Client
) -> None:
    name = database_url.rpartition("/")[2]
    ids = [_post(client, seed).json()["id"] for seed in range(2)]
    postgres.run(FULL, name)
    _assert_full(client.post("/compose", json={"objects": ids, "mode": "all"}))
    assert len(client.get("/objects").json()["items"]) == 2
    postgres.run("DROP TRIGGER disk_full ON uses", name)
    assert client.post("/compose", json={"objects": ids, "mode": "all"}).status_code == 201
