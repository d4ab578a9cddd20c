"""The log and the traces of a real process: one line and one span per request, and no secrets."""

import json
import signal
import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any

import httpx

from service.api.keys import make_key
from tests.support.processes import hof_serve
from tests.support.server import answering


@contextmanager
def collector() -> Iterator[tuple[str, list[tuple[str, bytes]]]]:
    """Run an OpenTelemetry collector; yield its address and the (path, body) of each call that it receives."""
    received: list[tuple[str, bytes]] = []

    class Collector(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            received.append((self.path, self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: object) -> None: ...

    with answering(Collector) as url:
        yield url, received


def _lines(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "log").read_text().splitlines()]


def _make_requests(client: httpx.Client, photo: bytes, database: Path) -> httpx.Response:
    """Make five requests, of which the last meets a broken database; return the answer to the first, an encoding."""
    answer = client.post("/encode", content=photo, headers={"X-Request-ID": "first"})
    assert (answer.status_code, answer.headers["x-request-id"]) == (201, "first")
    client.get(f"/objects/{answer.json()['id']}", headers={"X-Request-ID": "second"})
    assert client.get("/objects?limit=s3cret").status_code == 422
    assert client.get("/a%0A%22b%1B[31m", headers={"Authorization": "Bearer s3cret"}).status_code == 401
    with sqlite3.connect(database) as store:
        store.execute("ALTER TABLE objects RENAME TO gone")
    store.close()
    assert client.get("/objects", headers={"X-Request-ID": "fault"}).status_code == 500
    return answer


def test_logs_and_traces_of_requests_have_one_entry_each_and_no_secret(
    model_path: Path, tmp_path: Path, photo: bytes
) -> None:
    token, key = make_key("shop", frozenset({"read", "write"}))
    (tmp_path / "keys").write_text(key.line)
    with (
        collector() as (address, spans),
        hof_serve(
            tmp_path,
            model_path,
            "--api-keys-file",
            "keys",
            OTEL_EXPORTER_OTLP_ENDPOINT=address,
            OTEL_EXPORTER_OTLP_COMPRESSION="none",
        ) as (url, process),
        httpx.Client(base_url=url, headers={"Authorization": f"Bearer {token}"}, timeout=60) as client,
    ):
        answer = _make_requests(client, photo, tmp_path / "hof.db")
        process.send_signal(signal.SIGTERM)
        process.wait(60)
    lines = {line["request_id"]: line for line in _lines(tmp_path) if "status" in line}
    first, second = lines["first"], lines["second"]
    assert len(lines) == 5
    assert (first["method"], first["route"], first["path"], first["status"]) == ("POST", "/encode", "/encode", 201)
    assert (first["key"], first["level"], first["bytes"]) == ("shop", "info", len(answer.content))
    assert first["seconds"] > 0
    assert (second["route"], second["path"]) == ("/objects/{id}", f"/objects/{answer.json()['id']}")
    traced = [line for line in _lines(tmp_path) if "trace" in line]
    assert traced
    assert {line["request_id"] for line in traced} == {"fault"}
    assert all("no such table" in line["trace"] for line in traced)
    log = (tmp_path / "log").read_text()
    assert token not in log
    assert "s3cret" not in log
    assert {path for path, _ in spans} == {"/v1/traces"}
    sent = b"".join(body for _, body in spans)
    assert b"GET /objects/{id}" in sent
    assert bytes.fromhex(first["trace_id"]) in sent
    assert token.encode() not in sent


def test_text_log_of_a_request_is_one_line(model_path: Path, tmp_path: Path) -> None:
    with hof_serve(tmp_path, model_path, HOF_LOG_FORMAT="text") as (url, _):
        httpx.get(f"{url}/a%0Ab", headers={"X-Request-ID": "mine"})
    (line,) = [line for line in (tmp_path / "log").read_text().splitlines() if "request_id=mine" in line]
    assert " info GET /a%0Ab 404 " in line
