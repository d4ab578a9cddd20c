"""API keys, scopes and rates: decided before a body is read."""

import hashlib
import re
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from service.api.keys import Keys, make_key
from service.api.middleware.access import MAX_DROPPED
from service.cli.main import main
from service.errors import InvalidKeys
from service.settings import Settings
from tests.support.raw_sockets import next_status
from tests.support.server import running

SCOPES = {"reader": {"read"}, "writer": {"read", "write"}, "prometheus": {"metrics"}}
DIGEST = hashlib.sha256(b"x").hexdigest()


@pytest.fixture(scope="module")
def keys_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("keys") / "keys"


@pytest.fixture(scope="module")
def tokens(keys_file: Path) -> dict[str, str]:
    """Keys by name, which the file has."""
    pairs = {name: make_key(name, frozenset(scopes)) for name, scopes in SCOPES.items()}
    keys_file.write_text("# ours\n\n" + "".join(f"{key.line}\n" for _, key in pairs.values()))
    return {name: token for name, (token, _) in pairs.items()}


@pytest.fixture(scope="module")
def keyed(model_path: Path, keys_file: Path, tokens: dict[str, str]) -> Iterator[httpx.Client]:
    """Open a client of a service with keys."""
    store = f"sqlite:///{keys_file.parent / 'hof.db'}"
    settings = Settings(model=(model_path,), database_url=store, threads=1, api_keys_file=keys_file, metrics="key")
    with running(settings) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}", timeout=60) as client:
        yield client


def _bearer(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


def test_call_without_a_valid_key_answers_401_with_instructions(keyed: httpx.Client, tokens: dict[str, str]) -> None:
    wrong = tokens["reader"][:-1] + ("A" if tokens["reader"][-1] != "A" else "B")
    faulty: list[dict[str, str]] = [
        {},
        _bearer(wrong),
        {"Authorization": f"Basic {tokens['reader']}"},
        {"X-API-Key": "x"},
    ]
    for headers in faulty:
        for method, path in (("GET", "/objects"), ("POST", "/encode"), ("GET", "/nope"), ("GET", "/metrics")):
            answer = keyed.request(method, path, headers=headers)
            assert (answer.status_code, answer.json()["type"]) == (401, "urn:hof:problem:unauthenticated")
            assert answer.headers["www-authenticate"] == 'Bearer realm="hof"'
            assert answer.headers["content-type"] == "application/problem+json"
            assert answer.headers["x-request-id"]


@pytest.mark.parametrize(
    ("name", "method", "path", "status"),
    [
        ("reader", "GET", "/objects", 200),
        ("reader", "HEAD", "/objects", 200),
        ("reader", "POST", "/encode", 403),
        ("reader", "DELETE", "/objects/x", 403),
        ("reader", "GET", "/v2/models/tiny-k2", 200),
        ("reader", "POST", "/v2/models/tiny-k2/infer", 403),
        ("reader", "GET", "/metrics", 403),
        ("writer", "POST", "/encode", 415),
        ("writer", "DELETE", "/objects/x", 404),
        ("prometheus", "GET", "/metrics", 200),
        ("prometheus", "GET", "/model", 403),
    ],
)
def test_call_with_a_key_is_allowed_by_its_scopes_only(
    keyed: httpx.Client, tokens: dict[str, str], name: str, method: str, path: str, status: int
) -> None:
    for headers in (_bearer(tokens[name]), {"X-API-Key": tokens[name]}, {"Authorization": f"bearer  {tokens[name]}"}):
        answer = keyed.request(method, path, headers=headers)
        assert answer.status_code == status
        if status == 403:
            scope = "metrics" if path == "/metrics" else "read" if method == "GET" else "write"
            assert answer.json()["detail"] == f"this call needs a key of the scope {scope}"
            assert f'scope="{scope}"' in answer.headers["www-authenticate"]


@pytest.mark.parametrize(
    "path", ["/", "/docs", "/openapi.json", "/viewer/js/main.js", "/health/live", "/health/ready", "/v2/health/ready"]
)
def test_probes_and_pages_without_a_key_answer_200(keyed: httpx.Client, path: str) -> None:
    assert keyed.get(path).status_code == 200


def test_refusal_of_a_large_body_comes_before_the_body_and_closes(keyed: httpx.Client, tokens: dict[str, str]) -> None:
    for header, status in (("X: y", b"401"), (f"X-API-Key: {tokens['reader']}", b"403")):
        for body in ("Content-Length: 10000000", "Transfer-Encoding: chunked"):
            with socket.create_connection((keyed.base_url.host, keyed.base_url.port or 0), timeout=60) as slow:
                slow.sendall(
                    f"POST /encode HTTP/1.1\r\nHost: x\r\nExpect: 100-continue\r\n{header}\r\n{body}\r\n\r\n".encode()
                )
                answer = b""
                while piece := slow.recv(65536):  # to the end: the service closes
                    answer += piece
            assert answer.startswith(b"HTTP/1.1 " + status)
            assert b"connection: close" in answer.lower()


def test_refusal_of_a_small_body_keeps_the_connection(keyed: httpx.Client) -> None:
    address = (keyed.base_url.host, keyed.base_url.port or 0)
    with socket.create_connection(address, timeout=60) as connection:
        for _ in range(2):
            connection.sendall(b"POST /encode HTTP/1.1\r\nHost: x\r\nContent-Length: %d\r\n\r\n" % MAX_DROPPED)
            assert next_status(connection) == 401  # before a byte of the body
            connection.sendall(b"GET /objects HTTP/1.1\r\n\r\n".ljust(MAX_DROPPED))
        connection.sendall(b"GET /health/live HTTP/1.1\r\nHost: x\r\n\r\n")
        assert next_status(connection) == 200
        connection.sendall(b"POST /encode HTTP/1.1\r\nHost: x\r\nContent-Length: %d\r\n\r\n" % (MAX_DROPPED + 1))
        assert next_status(connection) == 401
        assert connection.recv(1) == b""  # a larger one is not taken


def test_points_with_a_key_are_not_shared_between_clients_by_caches(
    keyed: httpx.Client, tokens: dict[str, str], photo: bytes
) -> None:
    link = keyed.post("/encode", content=photo, headers=_bearer(tokens["writer"])).json()["links"]["points"]
    answer = keyed.get(link, headers=_bearer(tokens["reader"]))
    assert "public" not in answer.headers["cache-control"]
    assert {"Authorization", "X-API-Key", "Accept"} <= set(answer.headers["vary"].split(", "))


def test_metrics_without_the_key_setting_need_no_key(
    settings: Settings, keys_file: Path, tokens: dict[str, str]
) -> None:
    with running(settings.model_copy(update={"api_keys_file": keys_file})) as server:
        address = f"http://127.0.0.1:{server.port}"
        assert httpx.get(f"{address}/metrics").status_code == 200
        assert httpx.get(f"{address}/objects").status_code == 401


def test_hof_key_shows_the_token_once_and_prints_its_entry(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["key", "shop", "--scope", "write", "--scope", "read"]) == 0
    captured = capsys.readouterr()
    token = captured.err.split()[-1]
    assert re.fullmatch(r"hof_[\w-]{43}", token)
    assert captured.out == f"shop read,write {hashlib.sha256(token.encode()).hexdigest()}\n"
    (tmp_path / "keys").write_text(captured.out)
    key = Keys.read(tmp_path / "keys").find(token.encode())
    assert key
    assert (key.name, sorted(key.scopes)) == ("shop", ["read", "write"])


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "has no key"),
        ("# none\n", "has no key"),
        (f"a read {DIGEST}\nb read\n", "line 2 .* is malformed"),
        (f"a read,fly {DIGEST}\n", "line 1 .* is malformed"),
        ("a read hof_0123456789\n", "line 1 .* is malformed"),
        (f"a/b read {DIGEST}\n", "line 1 .* is malformed"),
        (f"a read {DIGEST}\na write {DIGEST}\n", "names two keys alike"),
        (b"\xff", "is no text"),
    ],
)
def test_keys_file_with_a_fault_is_refused(tmp_path: Path, content: str | bytes, message: str) -> None:
    path = tmp_path / "keys"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(InvalidKeys, match=message) as caught:
        Keys.read(path)
    assert "hof_0123" not in caught.value.detail


def test_keys_file_writable_by_anyone_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "keys"
    path.write_text(f"a read {DIGEST}\n")
    assert len(Keys.read(path)) == 1
    path.chmod(0o646)
    with pytest.raises(InvalidKeys, match="chmod o-w"):
        Keys.read(path)


def test_rate_limit_with_keys_counts_by_key_and_is_reported(
    settings: Settings, keys_file: Path, tokens: dict[str, str]
) -> None:
    changed = settings.model_copy(update={"api_keys_file": keys_file, "rate_limit": "3/month"})
    with running(changed) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}") as client:
        for left in (2, 1, 0):
            answer = client.get("/objects", headers=_bearer(tokens["reader"]))
            assert answer.status_code == 200
            assert answer.headers["ratelimit-policy"] == '"requests";q=3;w=2592000'
            assert answer.headers["ratelimit"].startswith(f'"requests";r={left};t=')
        answer = client.get("/objects", headers=_bearer(tokens["reader"]))
        assert (answer.status_code, answer.json()["type"]) == (429, "urn:hof:problem:rate-limited")
        wait_s = int(answer.headers["retry-after"])
        assert 1 <= wait_s <= 2 * 2_592_000
        assert answer.headers["ratelimit"] == f'"requests";r=0;t={wait_s}'
        assert client.get("/objects", headers=_bearer(tokens["writer"])).status_code == 200
        for path in ("/health/live", "/health/ready", "/"):
            assert client.get(path).status_code == 200
        assert 'hof_http_unserved_total{reason="limited"} 1.0' in client.get("/metrics").text


def test_rate_limit_without_keys_counts_by_address(settings: Settings) -> None:
    with running(settings.model_copy(update={"rate_limit": "1/month"})) as server:
        address = f"http://127.0.0.1:{server.port}/objects"
        assert [httpx.get(address).status_code for _ in range(2)] == [200, 429]
        transport = httpx.HTTPTransport(local_address="127.0.0.2")
        with httpx.Client(transport=transport) as elsewhere:
            assert elsewhere.get(address).status_code == 200


def test_rate_limit_after_the_retry_time_admits_the_client(settings: Settings) -> None:
    changed = settings.model_copy(update={"rate_limit": "2 per 3 second"})
    with running(changed) as server, httpx.Client(base_url=f"http://127.0.0.1:{server.port}") as client:
        refused = next(answer for _ in range(100) if (answer := client.get("/objects")).status_code == 429)
        time.sleep(int(refused.headers["retry-after"]))
        assert client.get("/objects").status_code == 200
