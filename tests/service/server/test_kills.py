"""Stops of real processes under write load: SIGKILL loses nothing acknowledged, SIGTERM loses no call."""

import contextlib
import random
import signal
import socket
import threading
from pathlib import Path

import httpx
import pytest

from service.formats.weights import Weights, dump
from service.mapping.spec import initial_theta
from tests.support.ledger import SPEC, Ledger, kill, lost, stop
from tests.support.processes import Served, flags, hof_serve, is_ready
from tests.support.raw_sockets import rest

KILLS = 10
POINTS = 4_000_000  # more bytes, as f32, than the sockets' buffers hold
FILE = dump(Weights(SPEC, initial_theta(SPEC), "m"), "safetensors")


def test_sigkill_loses_nothing_that_was_acknowledged(tmp_path: Path, model_path: Path) -> None:
    draw, ledger = random.Random(0), Ledger()
    for _ in range(KILLS):
        kill(tmp_path, ledger, 1 + draw.randrange(40), model=model_path)
        assert lost(tmp_path, ledger) == []
    assert len(ledger.words) >= 4
    with hof_serve(tmp_path, model_path) as served:
        assert lost(tmp_path, ledger, served.url) == []


def test_lost_with_missing_and_changed_objects_names_them(tmp_path: Path, model_path: Path) -> None:
    ledger = Ledger()
    kill(tmp_path, ledger, 8, model=model_path)
    name = next(iter(ledger.thetas))
    ledger.thetas |= {"0" * 32: b"", name: b"other"}
    assert sorted(lost(tmp_path, ledger)) == sorted(["0" * 32, name])


@pytest.mark.parametrize("workers", [1, 2])
def test_sigterm_loses_no_call_of_clients_that_write_until_refused(
    tmp_path: Path, model_path: Path, workers: int
) -> None:
    ledger = Ledger()
    stop(tmp_path, ledger, model=model_path, workers=workers)
    assert ledger.broken == []
    assert len(ledger.thetas) > 4
    assert lost(tmp_path, ledger) == []


def _connect(served: Served, request: str) -> socket.socket:
    url = httpx.URL(served.url)
    connection = socket.create_connection((url.host, url.port), timeout=120)
    connection.sendall(request.encode())
    return connection


def _refusal(served: Served) -> threading.Thread:
    """Start a thread that ends once the server refuses connections."""

    def probe() -> None:
        with contextlib.suppress(ConnectionError):
            while True:
                is_ready(served.url)

    thread = threading.Thread(target=probe)
    thread.start()
    return thread


def test_sigterm_while_draining_is_unready_and_completes_calls_in_progress(tmp_path: Path, model_path: Path) -> None:
    with hof_serve(tmp_path, model_path, *flags(drain_s=3600, shutdown_s=120)) as served:
        links = httpx.post(f"{served.url}/objects", content=FILE).json()["links"]
        download = _connect(served, f"GET {links['points']}?n={POINTS}&format=f32 HTTP/1.1\r\nHost: x\r\n\r\n")
        head = download.recv(1000)
        upload = _connect(served, f"POST /objects HTTP/1.1\r\nHost: x\r\nContent-Length: {len(FILE)}\r\n\r\n")
        upload.sendall(FILE[:100])
        with httpx.Client(base_url=served.url, timeout=60) as client:
            assert "connection" not in client.get("/health/ready").headers
            served.process.send_signal(signal.SIGTERM)
            while (probe := client.get("/health/ready")).status_code == 200:
                pass
            assert (probe.status_code, probe.headers["connection"]) == (503, "close")
            assert probe.json()["detail"] == "the service is stopping"
            answer = client.get(links["self"])
            assert (answer.status_code, answer.headers["connection"]) == (200, "close")
        served.process.send_signal(signal.SIGTERM)  # ends the draining
        _refusal(served).join()
        assert served.process.poll() is None
        upload.sendall(FILE[100:])
        with upload:
            assert rest(upload).startswith(b"HTTP/1.1 200 ")
        with download:
            head, _, body = (head + rest(download)).partition(b"\r\n\r\n")
        assert head.startswith(b"HTTP/1.1 200 ")
        assert len(body) == POINTS * 3 * 4
        assert served.process.wait(60) in (0, -signal.SIGTERM)


@pytest.mark.parametrize("first", [signal.SIGTERM, signal.SIGINT])
def test_stop_with_a_client_that_does_not_read_ends_after_shutdown_s(
    tmp_path: Path, model_path: Path, first: signal.Signals
) -> None:
    settings = {"drain_s": 0 if first == signal.SIGTERM else 3600, "shutdown_s": 1, "client_timeout_s": 3600}
    with hof_serve(tmp_path, model_path, *flags(**settings)) as served:
        links = httpx.post(f"{served.url}/objects", content=FILE).json()["links"]
        with _connect(served, f"GET {links['points']}?n={POINTS}&format=f32 HTTP/1.1\r\nHost: x\r\n\r\n") as stuck:
            stuck.recv(1000)
            served.process.send_signal(first)
            served.process.wait(60)  # nothing but shutdown_s ends it: both other times are an hour
    assert "timeout graceful shutdown exceeded" in (tmp_path / "log").read_text()
