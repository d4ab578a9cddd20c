"""Requests that no ordinary client sends, at `hof serve` with keys: none gets around its key's scope."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from service.api.keys import make_key
from tests.support.photos import disc, image_file
from tests.support.processes import hof_serve
from tests.support.raw_sockets import ask, connect_to, next_answer

PHOTO = image_file(disc())
CHUNKED = b"POST /encode HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n"


@pytest.fixture(scope="module")
def keyed(tmp_path_factory: pytest.TempPathFactory, model_path: Path) -> Iterator[tuple[str, str, str]]:
    """Run a service with keys: its URL, a key that may read, and one that may write."""
    folder = tmp_path_factory.mktemp("keyed")
    reader, writer = (make_key(scope, frozenset({scope})) for scope in ("read", "write"))
    (folder / "keys").write_text(f"{reader[1].line}\n{writer[1].line}\n")
    flags = (f"--api-keys-file={folder / 'keys'}", "--metrics=key")
    with hof_serve(folder, model_path, *flags) as (url, _):
        yield url, reader[0], writer[0]


def test_trailers_never_become_fields(keyed: tuple[str, str, str]) -> None:
    url, _, writer = keyed
    chunked = CHUNKED + b"%x\r\n%b\r\n0\r\n" % (len(PHOTO), PHOTO)
    for name in ("X-API-Key: ", "Authorization: Bearer "):
        trailer = f"{name}{writer}\r\n\r\n".encode()
        for parts in ([chunked + trailer], [CHUNKED, chunked[len(CHUNKED) :] + trailer]):
            assert ask(url, *parts).status == 401
    with connect_to(url) as connection:  # nor fields of the next request
        allowed = chunked.replace(b"Host", f"X-API-Key: {writer}\r\nHost".encode())
        connection.sendall(allowed + f"X-API-Key: {writer}\r\n\r\n".encode())
        assert next_answer(connection).status in (200, 201)
        connection.sendall(b"GET /objects HTTP/1.1\r\nHost: x\r\n\r\n")
        assert next_answer(connection).status == 401


@pytest.mark.parametrize(
    "path",
    [
        *("/metrics%0A", "/metrics%0a", "/metrics%0D", "/metrics%0A%0A", "/metrics%00", "/metrics%20", "/metrics/"),
        *("//metrics", "/metrics%2F", "/%2Fmetrics", "/./metrics", "/x/../metrics", "/metrics;a", "/METRICS"),
        "/metric%73",
    ],
)
def test_path_in_another_spelling_needs_the_same_scope(keyed: tuple[str, str, str], path: str) -> None:
    url, reader, _ = keyed
    answer = ask(url, f"GET {path} HTTP/1.1\r\nHost: x\r\nX-API-Key: {reader}\r\n\r\n".encode())
    assert answer.status in (403, 404)
    assert b"hof_http" not in answer.body


@pytest.mark.parametrize("ending", ["", "%0A", "%0D%0A", "/", "%00"])
def test_method_that_changes_needs_the_scope_in_every_spelling(keyed: tuple[str, str, str], ending: str) -> None:
    url, reader, _ = keyed
    for line in (f"DELETE /objects/{32 * '0'}{ending}", f"POST /encode{ending}", f"POST /compose{ending}"):
        head = f"{line} HTTP/1.1\r\nHost: x\r\nX-API-Key: {reader}\r\nContent-Length: 0\r\n\r\n"
        assert ask(url, head.encode()).status == 403


def test_key_that_is_given_twice_is_refused(keyed: tuple[str, str, str]) -> None:
    url, reader, _ = keyed
    for name in ("X-API-Key: ", "Authorization: Bearer "):
        fields = f"{name}{reader}\r\n{name}x\r\n"
        assert ask(url, f"GET /objects HTTP/1.1\r\nHost: x\r\n{fields}\r\n".encode()).status == 401
