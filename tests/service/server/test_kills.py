"""What was acknowledged is there after SIGKILL; SIGTERM loses no call. Real processes under write load."""

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

KILLS = 10
POINTS = 4_000_000  # as f32 more than the sockets' buffers hold
FILE = dump(Weights(SPEC, initial_theta(SPEC), "m"), "safetensors")


def test_what_was_acknowledged_survives_sigkill(tmp_path: Path, model_path: Path) -> None:
    draw, ledger = random.Random(0), Ledger()
    for _ in range(KILLS):
        kill(tmp_path, ledger, 1 + draw.randrange(40), model=model_path)
        assert lost(tmp_path, ledger) == []
    assert len(ledger.words) >= 4
    with hof_serve(tmp_path, model_path) as served:
        assert lost(tmp_path, ledger, served.url) == []


def test_what_is_lost_is_noticed(tmp_path: Path, model_path: Path) -> None:
    ledger = Ledger()
    kill(tmp_path, ledger, 8, model=model_path)
    name = next(iter(ledger.thetas))
    ledger.thetas |= {"0" * 32: b"", name: b"other"}
    assert sorted(lost(tmp_path, ledger)) == sorted(["0" * 32, name])


def test_sigterm_loses_no_call_of_clients_that_go_on_until_they_are_refused(tmp_path: Path, model_path: Path) -> None:
    ledger = Ledger()
    stop(tmp_path, ledger, model=model_path)
    assert ledger.broken == []
    assert len(ledger.thetas) > 4
    assert lost(tmp_path, ledger) == []


def _connect(served: Served, request: str) -> socket.socket:
    url = httpx.URL(served.url)
    connection = socket.create_connection((url.host, url.port), timeout=120)
    connection.sendall(request.encode())
    return connection


def _rest(connection: socket.socket) -> bytes:
    """All that comes until the server closes."""
    with connection:
        return b"".join(iter(lambda: connection.recv(1 << 20), b""))


def _closes(served: Served) -> threading.Thread:
    """A thread that ends once the server takes no connection any more."""

    def probe() -> None:
        with contextlib.suppress(ConnectionError):
            while True:
                is_ready(served.url)

    thread = threading.Thread(target=probe)
    thread.start()
    return thread


def test_while_it_drains_it_is_unready_serves_on_and_ends_what_has_begun(tmp_path: Path, model_path: Path) -> None:
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
        served.process.send_signal(signal.SIGTERM)  # enough of it
        _closes(served).join()
        assert served.process.poll() is None
        upload.sendall(FILE[100:])
        assert _rest(upload).startswith(b"HTTP/1.1 200 ")
        head, _, body = (head + _rest(download)).partition(b"\r\n\r\n")
        assert head.startswith(b"HTTP/1.1 200 ")
        assert len(body) == POINTS * 3 * 4
        assert served.process.wait(60) in (0, -signal.SIGTERM)


@pytest.mark.parametrize("first", [signal.SIGTERM, signal.SIGINT])
def test_a_client_that_does_not_read_holds_the_stop_up_for_so_long_only(
    tmp_path: Path, model_path: Path, first: signal.Signals
) -> None:
    settings = {"drain_s": 0 if first == signal.SIGTERM else 3600, "shutdown_s": 1}
    with hof_serve(tmp_path, model_path, *flags(**settings)) as served:
        links = httpx.post(f"{served.url}/objects", content=FILE).json()["links"]
        with _connect(served, f"GET {links['points']}?n={POINTS}&format=f32 HTTP/1.1\r\nHost: x\r\n\r\n") as stuck:
            stuck.recv(1000)
            served.process.send_signal(first)
            served.process.wait(60)
