"""A service without keys answers no page of another site: neither by its own name for this machine, nor by a form."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from service.api.keys import make_key
from tests.support.processes import hof_serve
from tests.support.raw_sockets import ask

COMPOSITION = b'{"objects": []}'


@pytest.fixture(scope="module")
def url(tmp_path_factory: pytest.TempPathFactory, model_path: Path) -> Iterator[str]:
    flags = ("--allowed-hosts=hof.example,www.hof.example", "--cors-origins=https://shop.example")
    with hof_serve(tmp_path_factory.mktemp("served"), model_path, *flags) as (url, _):
        yield url


def head(line: str, *fields: str) -> bytes:
    return "\r\n".join([f"{line} HTTP/1.1", *fields, "", ""]).encode()


@pytest.mark.parametrize(
    "host",
    [
        *("localhost", "LOCALHOST:8080", "a.localhost", "127.0.0.1", "127.0.0.1:8080", "[::1]:8080", "10.1.2.3:8080"),
        *("hof", "hof:8080", "hof.example", "WWW.hof.example:443", "hof.example.", "hof.default.svc", "printer.local"),
        "hof.default.svc.cluster.local:8080",
    ],
)
def test_host_of_this_service_is_answered(url: str, host: str) -> None:
    assert ask(url, head("GET /objects", f"Host: {host}")).status == 200


@pytest.mark.parametrize(
    "host",
    [
        *("evil.example", "evil.example:8080", "evil.example.", "localhost.evil.example", "127.0.0.1.evil.example"),
        *("hof.example.evil.example", "evilhof.example", "a.hof.example", "1.2.3"),
    ],
)
@pytest.mark.parametrize("line", ["GET /objects", "GET /", "GET /metrics", "DELETE /objects/x", "GET /nope"])
def test_host_that_a_stranger_may_own_is_421(url: str, host: str, line: str) -> None:
    for request in (head(line, f"Host: {host}"), head(line.replace(" /", f" http://{host}/"), "Host: localhost")):
        answer = ask(url, request)
        assert (answer.status, answer.headers["content-type"]) == (421, "application/problem+json")
        assert b"--allowed-hosts" in answer.body


def test_probe_is_answered_for_any_host(url: str) -> None:
    for path in ("/health/live", "/health/ready", "/v2/health/ready"):
        assert ask(url, head(f"GET {path}", "Host: balancer.example")).status == 200
    assert ask(url, b"GET /objects HTTP/1.0\r\n\r\n").status == 200  # no browser omits Host


@pytest.mark.parametrize(
    "fields",
    [
        ["Origin: https://evil.example"],
        ["Origin: null"],
        ["Origin: http://localhost:3000"],
        ["Origin: http://localhost:8080.evil.example"],
        ["Sec-Fetch-Site: cross-site"],
        ["Sec-Fetch-Site: same-site", "Origin: http://localhost:3000"],
        ["Sec-Fetch-Site: same-origin", "Sec-Fetch-Site: cross-site"],
        ["Sec-Fetch-Site: cross-site", "Origin: http://localhost:8080"],
        ["Sec-Fetch-Site: cross-site", "Origin: https://shop.example.evil.example"],
    ],
)
@pytest.mark.parametrize("line", ["POST /compose", "POST /encode", "POST /objects", "DELETE /objects/x"])
def test_change_by_another_site_is_403(url: str, fields: list[str], line: str) -> None:
    size = f"Content-Length: {len(COMPOSITION)}"
    answer = ask(url, head(line, "Host: localhost:8080", "Content-Type: text/plain", size, *fields) + COMPOSITION)
    assert (answer.status, answer.headers["content-type"]) == (403, "application/problem+json")
    assert b"--cors-origins" in answer.body


@pytest.mark.parametrize(
    "fields",
    [
        [],
        ["Origin: http://localhost:8080"],
        ["Origin: https://localhost:8080"],  # behind a proxy with TLS
        ["Origin: http://localhost:8080", "Sec-Fetch-Site: same-origin"],
        ["Origin: https://hof.example", "Sec-Fetch-Site: same-origin"],  # behind a proxy that changes Host
        ["Sec-Fetch-Site: none"],
        ["Origin: https://shop.example", "Sec-Fetch-Site: cross-site"],
        ["Origin: https://shop.example"],
    ],
)
def test_change_by_an_own_page_or_a_named_one_passes(url: str, fields: list[str]) -> None:
    size = f"Content-Length: {len(COMPOSITION)}"
    answer = ask(url, head("POST /compose", "Host: localhost:8080", size, *fields) + COMPOSITION)
    assert answer.status == 422


def test_hosts_can_all_be_allowed_and_keys_need_no_check(tmp_path: Path, model_path: Path) -> None:
    token, key = make_key("all", frozenset({"read", "write"}))
    (tmp_path / "keys").write_text(f"{key.line}\n")
    for flag in ("--allowed-hosts=*", f"--api-keys-file={tmp_path / 'keys'}"):
        with hof_serve(tmp_path, model_path, flag) as (url, _):
            fields = ("Host: any.example", f"X-API-Key: {token}", "Origin: null", "Content-Length: 0")
            assert ask(url, head("GET /objects", *fields)).status == 200
            assert ask(url, head("POST /compose", *fields)).status == (400 if "keys" in flag else 403)
