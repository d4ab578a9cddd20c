"""moto's S3 server, on loopback, in an environment of its own: it pins other versions of our requirements."""

import os
import threading
from collections.abc import Container, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from typing import Final
from urllib.parse import quote

import httpx

from tests.support import ROOT
from tests.support.processes import serving
from tests.support.server import answering

PAIR_S: Final = 60  # longest wait for another read
PYTHON: Final = ROOT / ".venv" / "s3" / "bin" / "python"  # moto_server names the folder of its install


class S3:
    """A server at `url`. Until `require_keys`, it accepts all keys, and calls without."""

    def __init__(self, url: str) -> None:
        self.url = url

    def create(self, bucket: str) -> None:
        """Create a bucket."""
        httpx.put(f"{self.url}/{bucket}").raise_for_status()

    def put(self, name: str, content: bytes) -> None:
        """Write an object that everybody may read, BUCKET/KEY."""
        url = f"{self.url}/{quote(name)}"
        httpx.put(url, content=content, headers={"x-amz-acl": "public-read"}).raise_for_status()

    def require_keys(self) -> None:
        """Refuse all keys from now on, since nobody has created any."""
        httpx.post(f"{self.url}/moto-api/reset-auth", content=b"0").raise_for_status()

    def reset(self) -> None:
        """Remove all buckets, and accept all keys."""
        httpx.post(f"{self.url}/moto-api/reset-auth", content=b"inf").raise_for_status()
        httpx.post(f"{self.url}/moto-api/reset").raise_for_status()


@contextmanager
def running_s3() -> Iterator[S3]:
    """Run the server."""
    assert PYTHON.is_file(), "these tests read from moto's S3 server: `make .venv/s3/stamp` installs it"
    command = [str(PYTHON), "-m", "moto.server", "-H", "127.0.0.1", "-p", "{port}"]
    with serving(command, os.sched_getaffinity(0), ready="/moto-api/data.json") as (url, _):
        yield S3(url)


class _Handler(BaseHTTPRequestHandler):
    """Answers of known length, without a log."""

    protocol_version = "HTTP/1.1"

    def answer(self, status: HTTPStatus, body: bytes) -> None:
        """Send an answer; to HEAD, without its body."""
        self.send_response(status)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if self.command == "GET":
            self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Write nothing."""


@contextmanager
def server_of_pairs(content: bytes) -> Iterator[str]:
    """Serve one object under each name, and answer a read only beside another one."""
    pair = threading.Barrier(2)

    class Handler(_Handler):
        def do_HEAD(self) -> None:
            self.answer(HTTPStatus.OK, content)

        def do_GET(self) -> None:
            try:
                pair.wait(PAIR_S)
            except threading.BrokenBarrierError:
                self.send_error(HTTPStatus.NOT_FOUND)
            else:
                self.answer(HTTPStatus.OK, content)

    with answering(Handler) as url:
        yield url


@contextmanager
def server_without_lists(content: bytes, names: Container[str], archived: Container[str]) -> Iterator[str]:
    """Serve objects, BUCKET/KEY, to all keys, which may not list: as Amazon does, deny what does not exist."""

    class Handler(_Handler):
        def do_HEAD(self) -> None:
            name = self.path.removeprefix("/")
            self.answer(HTTPStatus.OK if name in names or name in archived else HTTPStatus.FORBIDDEN, content)

        def do_GET(self) -> None:
            name = self.path.removeprefix("/")
            if name in names:
                self.answer(HTTPStatus.OK, content)
            else:
                code = "InvalidObjectState" if name in archived else "AccessDenied"
                self.answer(HTTPStatus.FORBIDDEN, f"<Error><Code>{code}</Code><Message>no</Message></Error>".encode())

    with answering(Handler) as url:
        yield url
