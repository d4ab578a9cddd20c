"""A PostgreSQL that stops, freezes or refuses: 503 in time, unready, and recovery by itself. Real servers."""

import subprocess
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path

import httpx
import pytest

from service.formats.weights import Weights, dump
from service.mapping.spec import HOF_1, initial_theta
from tests.support.processes import HOF, flags, hof_serve, worker_pids
from tests.support.slow import until
from tests.support.systems.postgres import USER, Postgres, running_postgres
from tests.support.systems.postgres_faults import FAULTS, MAX_CONNECTIONS, stopped

pytestmark = pytest.mark.system

SPEC = HOF_1.with_k(2)
TIMEOUT_S = 2  # --database-timeout-s; also the time within which an unusable database must show in /health/ready
IN_TIME_S = 5 * TIMEOUT_S  # far more than a busy machine adds, far less than the 60 s of a call without the time-out
SLEEPING = "FROM pg_stat_activity WHERE wait_event = 'PgSleep'"


@pytest.fixture(scope="module")
def own_postgres() -> Iterator[Postgres]:
    with running_postgres(f"-c max_connections={MAX_CONNECTIONS}") as postgres:
        yield postgres


def _post(client: httpx.Client, seed: int) -> httpx.Response:
    return client.post("/objects", content=dump(Weights(SPEC, initial_theta(SPEC, seed), "m"), "safetensors"))


def _is_ready(client: httpx.Client) -> bool:
    return client.get("/health/ready").status_code == 200


def _check_outage(client: httpx.Client) -> None:
    """Check that the service gets unready, and that calls end with a 503, both in time.

    The bound is generous: `benchmarks.load.outages` measures the times.
    """
    start = time.monotonic()
    until(lambda: not _is_ready(client))
    assert time.monotonic() - start < IN_TIME_S
    assert client.get("/health/live").status_code == 200
    for _ in range(3):
        answer = _post(client, 2)
        assert (answer.status_code, answer.json()["title"]) == (503, "Store unavailable"), answer.text
        assert int(answer.headers["retry-after"]) >= 1
        assert answer.elapsed.total_seconds() < IN_TIME_S


@pytest.mark.parametrize("fault", FAULTS)
def test_service_with_postgresql_at_fault_answers_503_in_time_and_recovers(
    fault: str, own_postgres: Postgres, tmp_path: Path, model_path: Path
) -> None:
    url = own_postgres.create()
    settings = flags(database_url=url, database_timeout_s=TIMEOUT_S, database_connections=3)
    with (
        hof_serve(tmp_path, model_path, *settings) as served,
        httpx.Client(base_url=served.url, timeout=60) as client,
    ):
        kept = _post(client, 1).json()["links"]["self"]
        assert _is_ready(client)
        with FAULTS[fault](own_postgres, url.rpartition("/")[2]):
            _check_outage(client)
            assert client.get(kept).status_code == (200 if fault == "read-only" else 503)
        until(lambda: _is_ready(client))
        assert [_post(client, seed).status_code for seed in range(2, 8)] == [201] * 6
        assert client.get(kept).status_code == 200
    log = (tmp_path / "log").read_text()
    assert "the database cannot be used: " in log
    assert "Traceback" not in log


def test_service_behind_a_pgbouncer_that_restarts_answers_503_and_recovers(
    own_postgres: Postgres, tmp_path: Path, model_path: Path
) -> None:
    url = own_postgres.create()
    with ExitStack() as stack:
        bouncer = stack.enter_context(ExitStack())
        through = bouncer.enter_context(own_postgres.bouncer(url))
        settings = flags(database_url=through, database_timeout_s=TIMEOUT_S)
        served = stack.enter_context(hof_serve(tmp_path, model_path, *settings))
        client = stack.enter_context(httpx.Client(base_url=served.url, timeout=60))
        assert _post(client, 1).status_code == 201
        bouncer.close()
        _check_outage(client)
        port = int(through.rpartition(":")[2].partition("/")[0])
        stack.enter_context(own_postgres.bouncer(url, port))
        until(lambda: _is_ready(client))
        assert _post(client, 2).status_code == 201
    assert "Traceback" not in (tmp_path / "log").read_text()


def test_service_of_two_hosts_recovers_by_itself_when_the_standby_is_promoted(tmp_path: Path, model_path: Path) -> None:
    with running_postgres() as primary, primary.standby() as standby:
        database = primary.create().rpartition("/")[2]
        hosts = f"127.0.0.1:{primary.port},127.0.0.1:{standby.port}"
        settings = flags(database_url=f"postgresql://{USER}@{hosts}/{database}", database_timeout_s=TIMEOUT_S)
        with (
            hof_serve(tmp_path, model_path, *settings) as served,
            httpx.Client(base_url=served.url, timeout=60) as client,
        ):
            kept = _post(client, 1).json()["links"]["self"]
            with stopped(primary, database):
                _check_outage(client)
                assert client.get(kept).status_code == 503  # no host accepts writes, so none is used
                standby.promote()
                until(lambda: _is_ready(client))
                assert [_post(client, seed).status_code for seed in range(2, 6)] == [201] * 4
                assert client.get(kept).status_code == 200
    log = (tmp_path / "log").read_text()
    assert "the database cannot be used: " in log
    assert "Traceback" not in log


@contextmanager
def _locked(postgres: Postgres, name: str) -> Iterator[None]:
    """Hold a lock that every call of the service needs."""
    sql = "BEGIN; LOCK TABLE objects; SELECT 1; SELECT pg_sleep(600)"
    command = ["psql", "-h", "127.0.0.1", "-p", str(postgres.port), "-U", USER, "-d", name, "-X", "-q", "-c", sql]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            until(lambda: postgres.run(f"SELECT count(*) {SLEEPING}", name) == "1")
            yield
        finally:
            postgres.run(f"SELECT pg_terminate_backend(pid) {SLEEPING}", name)
            process.wait(60)


def test_call_past_the_servers_statement_timeout_answers_503(
    own_postgres: Postgres, tmp_path: Path, model_path: Path
) -> None:
    url = f"{own_postgres.create()}?options=-c%20statement_timeout%3D300"
    with (
        hof_serve(tmp_path, model_path, *flags(database_url=url)) as served,
        httpx.Client(base_url=served.url, timeout=60) as client,
    ):
        with _locked(own_postgres, url.rpartition("/")[2].partition("?")[0]):
            answer = client.get("/objects")
            assert (answer.status_code, answer.json()["title"]) == (503, "Store unavailable")
            assert _is_ready(client)
        assert client.get("/objects").status_code == 200
        assert 'hof_http_unserved_total{reason="failed"} 0.0' in client.get("/metrics").text
    assert "Traceback" not in (tmp_path / "log").read_text()


def test_service_opens_no_more_connections_than_its_setting(
    own_postgres: Postgres, tmp_path: Path, model_path: Path
) -> None:
    url = own_postgres.create()
    name = url.rpartition("/")[2]
    count = f"SELECT count(*) FROM pg_stat_activity WHERE datname = '{name}' AND application_name = 'hof-test'"
    settings = flags(database_url=f"{url}?application_name=hof-test", database_connections=3, database_timeout_s=5)
    with (
        hof_serve(tmp_path, model_path, *settings) as served,
        ThreadPoolExecutor(12) as pool,
        _locked(own_postgres, name),
    ):
        calls = [pool.submit(httpx.get, f"{served.url}/objects", timeout=60) for _ in range(12)]
        until(lambda: own_postgres.run(count, "postgres") == "3")
        while not all(call.done() for call in calls):
            assert int(own_postgres.run(count, "postgres")) <= 3
        assert all(call.result().status_code in (429, 503) for call in calls)


def test_serve_with_a_frozen_postgresql_is_refused_in_time_with_one_line(
    own_postgres: Postgres, tmp_path: Path, model_path: Path
) -> None:
    url = own_postgres.create()
    with own_postgres.frozen():
        run = subprocess.run(
            [HOF, "serve", "--port=0", f"--model={model_path}", *flags(database_url=url, database_timeout_s=1)],
            capture_output=True,
            text=True,
            timeout=60,
            cwd=tmp_path,
        )
    assert run.returncode == 2
    assert run.stderr.count("\n") == 1
    assert "cannot open the database" in run.stderr
    assert "did not answer in time" in run.stderr


def test_worker_that_dies_while_postgresql_is_down_comes_back_after_it(
    own_postgres: Postgres, tmp_path: Path, model_path: Path
) -> None:
    url = own_postgres.create()
    settings = flags(database_url=url, database_timeout_s=TIMEOUT_S, workers=2)
    with (
        hof_serve(tmp_path, model_path, *settings, HOF_LOG_FORMAT="text") as served,
        httpx.Client(base_url=served.url, timeout=60) as client,
    ):
        log = tmp_path / "log"
        until(lambda: log.read_text().count("startup complete") == 2)
        workers = worker_pids(served.process.pid)
        own_postgres.stop()
        try:
            subprocess.run(["kill", "-KILL", str(workers[-1])], check=True)
            until(lambda: "trying again" in log.read_text())
            assert served.process.poll() is None
            assert client.get("/health/ready").status_code == 503
        finally:
            own_postgres.start()
        until(lambda: log.read_text().count("startup complete") == 3)
        assert _post(client, 1).status_code == 201
