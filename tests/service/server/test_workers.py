"""Several worker processes: one service, one store, metrics that add up, and signals to their supervisor."""

import json
import os
import shutil
import signal
import socket
import time
from pathlib import Path

import httpx

from service.formats.weights import Weights, dump
from service.mapping.spec import initial_theta
from tests.support.ledger import SPEC
from tests.support.photos import disc, image_file
from tests.support.processes import flags, hof_serve
from tests.support.raw_sockets import rest
from tests.support.slow import until

OBJECTS = 6
POINTS = 4_000_000  # more bytes, as f32, than the sockets' buffers hold
STARTED, ENDED = "startup complete", "Finished server process"


def _pids(folder: Path, text: str) -> set[int]:
    """Return the processes that logged a text."""
    whole_lines = (folder / "log").read_text().rpartition("\n")[0].splitlines()
    return {json.loads(line)["pid"] for line in whole_lines if text in line}


def _counted(url: str, route: str) -> float:
    """Return the answered requests of a route, by /metrics."""
    lines = httpx.get(f"{url}/metrics", timeout=60).text.splitlines()
    counters = [line for line in lines if line.startswith("hof_http_requests_total{") and f'route="{route}"' in line]
    return sum(float(line.rsplit(" ", 1)[1]) for line in counters)


def _stream(url: str) -> socket.socket:
    """Ask for points on a connection of its own, and return it before the answer is read."""
    file = dump(Weights(SPEC, initial_theta(SPEC), "m"), "safetensors")
    path = httpx.post(f"{url}/objects", content=file, timeout=60).json()["links"]["points"]
    address = httpx.URL(url)
    connection = socket.create_connection((address.host, address.port), timeout=120)
    connection.sendall(f"GET {path}?n={POINTS}&format=f32 HTTP/1.1\r\nHost: x\r\n\r\n".encode())
    return connection


def _is_free(port: int) -> bool:
    """Return whether another process could listen on a port."""
    try:
        socket.create_server(("127.0.0.1", port)).close()
    except OSError:
        return False
    return True


def test_workers_of_one_service_share_store_and_metrics(model_path: Path, tmp_path: Path) -> None:
    with hof_serve(tmp_path, model_path, "--workers", "2", HOF_LOG_FORMAT="json") as (url, _):
        until(lambda: len(_pids(tmp_path, STARTED)) == 2)
        requests = 0
        while len(_pids(tmp_path, '"route": "/model"')) < 2:  # a connection each: either may take it
            assert httpx.get(f"{url}/model", timeout=60).status_code == 200
            requests += 1
        for _ in range(10):
            assert _counted(url, "/model") == requests
        photos = [image_file(disc(size=(120 + index, 90))) for index in range(OBJECTS)]
        for photo in photos:
            assert httpx.post(f"{url}/encode", content=photo, timeout=60).status_code == 201
        for _ in range(10):
            assert len(httpx.get(f"{url}/objects", timeout=60).json()["items"]) == OBJECTS

        workers = _pids(tmp_path, STARTED)
        os.kill(workers.pop(), signal.SIGKILL)
        until(lambda: len(_pids(tmp_path, STARTED)) == 3)
        assert _counted(url, "/model") == requests
        in_flight = [line for line in httpx.get(f"{url}/metrics").text.splitlines() if "in_flight " in line]
        assert in_flight[-1] == "hof_http_requests_in_flight 1.0"
    assert not list(Path(os.environ.get("TMPDIR", "/tmp")).glob(f"hof-metrics-*/*_{workers.pop()}*.db"))


def test_supervisor_on_signals_adds_replaces_and_removes_workers(model_path: Path, tmp_path: Path) -> None:
    with hof_serve(tmp_path, model_path, "--workers", "2", HOF_LOG_FORMAT="json", HOF_DRAIN_S="0") as (url, process):
        until(lambda: len(_pids(tmp_path, STARTED)) == 2)
        first = _pids(tmp_path, STARTED)
        process.send_signal(signal.SIGHUP)
        until(lambda: _pids(tmp_path, ENDED) == first)
        second = _pids(tmp_path, STARTED) - first
        assert len(second) == 2
        process.send_signal(signal.SIGTTIN)
        until(lambda: len(_pids(tmp_path, STARTED)) == 5)
        process.send_signal(signal.SIGTTOU)
        until(lambda: len(_pids(tmp_path, ENDED)) == 3)
        (last,) = _pids(tmp_path, STARTED) - first - second
        assert _pids(tmp_path, ENDED) == first | {last}
        assert httpx.get(f"{url}/health/ready", timeout=60).status_code == 200
        process.terminate()
        assert process.wait(60) == 0
    assert _pids(tmp_path, ENDED) == first | second | {last}


def test_supervisor_of_workers_that_cannot_start_ends_the_service(model_path: Path, tmp_path: Path) -> None:
    with hof_serve(tmp_path, model_path, "--workers", "2", HOF_LOG_FORMAT="json") as (_, process):
        until(lambda: len(_pids(tmp_path, STARTED)) == 2)
        workers = _pids(tmp_path, STARTED)
        (tmp_path / "hof.db").write_bytes(b"no database" * 1000)
        os.kill(workers.pop(), signal.SIGKILL)
        process.wait(60)
    assert "cannot start; the service stops" in (tmp_path / "log").read_text()


def test_workers_of_a_killed_supervisor_end_and_free_the_port(model_path: Path, tmp_path: Path) -> None:
    with hof_serve(
        tmp_path, model_path, *flags(workers=2, drain_s=60, client_timeout_s=3600), HOF_LOG_FORMAT="json"
    ) as (url, process):
        until(lambda: len(_pids(tmp_path, STARTED)) == 2)
        workers, port = _pids(tmp_path, STARTED), httpx.URL(url).port
        assert port
        with _stream(url) as stream:
            stream.recv(1000)
            process.kill()
            until(lambda: _is_free(port))
            assert len(rest(stream)) > POINTS * 3 * 4 - 1000  # the call in progress ends as it should
        until(lambda: _pids(tmp_path, ENDED) == workers)


def test_supervisor_on_sighup_lets_streams_end(model_path: Path, tmp_path: Path) -> None:
    settings = flags(workers=2, drain_s=0, shutdown_s=1, client_timeout_s=3600)
    with hof_serve(tmp_path, model_path, *settings, HOF_LOG_FORMAT="json") as (url, process):
        until(lambda: len(_pids(tmp_path, STARTED)) == 2)
        first = _pids(tmp_path, STARTED)
        with _stream(url) as stream:
            head = stream.recv(1000)
            process.send_signal(signal.SIGHUP)
            until(lambda: len(_pids(tmp_path, STARTED)) == 4)
            until(lambda: len(_pids(tmp_path, ENDED)) == 1)
            time.sleep(2)  # longer than shutdown_s
            assert len(_pids(tmp_path, ENDED)) == 1
            assert httpx.get(f"{url}/health/ready", timeout=60).status_code == 200
            body = (head + rest(stream)).partition(b"\r\n\r\n")[2]
            assert len(body) == POINTS * 3 * 4
        until(lambda: _pids(tmp_path, ENDED) == first)
        process.terminate()
        assert process.wait(60) == 0


def test_supervisor_on_sigterm_ends_a_stream_that_outlives_a_restart(model_path: Path, tmp_path: Path) -> None:
    settings = flags(workers=2, drain_s=0, shutdown_s=1, client_timeout_s=3600)
    with hof_serve(tmp_path, model_path, *settings, HOF_LOG_FORMAT="json") as (url, process):
        until(lambda: len(_pids(tmp_path, STARTED)) == 2)
        with _stream(url) as stream:
            stream.recv(1000)
            process.send_signal(signal.SIGHUP)
            until(lambda: len(_pids(tmp_path, STARTED)) == 4)
            process.terminate()
            assert process.wait(60) == 0


def test_metrics_after_their_folder_vanished_are_complete(model_path: Path, tmp_path: Path) -> None:
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    environment = {"HOF_LOG_FORMAT": "json", "TMPDIR": str(temporary)}
    with hof_serve(tmp_path, model_path, "--workers", "2", **environment) as (url, _):
        until(lambda: len(_pids(tmp_path, STARTED)) == 2)
        requests = 0
        while len(_pids(tmp_path, '"route": "/model"')) < 2:
            assert httpx.get(f"{url}/model", timeout=60).status_code == 200
            requests += 1
        (folder,) = temporary.glob("hof-metrics-*")
        shutil.rmtree(folder)
        time.sleep(1.5)  # each worker looks for its files once a second, when it counts
        for _ in range(10):
            httpx.get(f"{url}/health/live", timeout=60).raise_for_status()
        until(lambda: _counted(url, "/model") == requests)
        os.kill(_pids(tmp_path, STARTED).pop(), signal.SIGKILL)
        until(lambda: len(_pids(tmp_path, STARTED)) == 3)
        in_flight = [line for line in httpx.get(f"{url}/metrics").text.splitlines() if "in_flight " in line]
        assert in_flight[-1] == "hof_http_requests_in_flight 1.0"
    assert "Traceback" not in (tmp_path / "log").read_text()
