"""Clients at `hof serve`, told apart by address: whose address is believed, and how much each may hold."""

import json
import socket
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest

from tests.support.photos import disc, image_file
from tests.support.processes import hof_serve
from tests.support.raw_sockets import ask, connect_to
from tests.support.slow import DEADLINE_S, until

OTHER = "127.0.0.2"
UPLOAD = b"POST /encode HTTP/1.1\r\nHost: x\r\nContent-Length: 1000000\r\n\r\n"
PHOTO = image_file(disc())


def photo_request() -> bytes:
    return b"POST /encode HTTP/1.1\r\nHost: x\r\nContent-Length: %d\r\n\r\n" % len(PHOTO) + PHOTO


def clients_in(folder: Path) -> list[str]:
    """Return the clients of the access log, in order."""
    entries = map(json.loads, (folder / "log").read_text().rpartition("\n")[0].splitlines())
    return [entry["client"] for entry in entries if "route" in entry]


def listing(forwarded: str) -> bytes:
    return f"GET /objects HTTP/1.1\r\nHost: x\r\nX-Forwarded-For: {forwarded}\r\n\r\n".encode()


def test_forwarded_address_is_believed_from_nobody_by_default(model_path: Path, tmp_path: Path) -> None:
    environment = {"FORWARDED_ALLOW_IPS": "*"}  # uvicorn's own variable
    flags = ("--rate-limit=3/hour", "--log-format=json")
    with hof_serve(tmp_path, model_path, *flags, **environment) as (url, _):
        statuses = [ask(url, listing(f"10.0.0.{number}")).status for number in range(4)]
        assert statuses == [200, 200, 200, 429]
        until(lambda: len(clients_in(tmp_path)) == 4)
        assert set(clients_in(tmp_path)) == {"127.0.0.1"}


def test_forwarded_address_is_believed_from_the_named_proxies(model_path: Path, tmp_path: Path) -> None:
    flags = ("--trusted-proxies=10.9.0.0/16,127.0.0.2", "--log-format=json")
    with hof_serve(tmp_path, model_path, *flags) as (url, _):
        for forwarded, source in (
            ("192.0.2.1", "127.0.0.1"),
            ("192.0.2.1", OTHER),
            ("6.6.6.6, 192.0.2.2", OTHER),  # the first one is the client's own word
            ("6.6.6.6, 192.0.2.3, 10.9.8.7", OTHER),
        ):
            assert ask(url, listing(forwarded), source=source).status == 200
        until(lambda: len(clients_in(tmp_path)) == 4)
        assert clients_in(tmp_path) == ["127.0.0.1", "192.0.2.1", "192.0.2.2", "192.0.2.3"]


def test_addresses_of_an_ipv6_network_share_a_rate(model_path: Path, tmp_path: Path) -> None:
    flags = ("--trusted-proxies=127.0.0.1", "--rate-limit=3/hour", "--log-format=json")
    network = ["2001:db8::1", "2001:db8:0:0:ffff::2", "2001:DB8::3", "2001:db8::4"]
    others = ["2001:db8:0:1::1", "::ffff:192.0.2.1", "::ffff:192.0.2.2", "192.0.2.2", "fe80::1%eth0"]
    with hof_serve(tmp_path, model_path, *flags) as (url, _):
        assert [ask(url, listing(address)).status for address in network] == [200, 200, 200, 429]
        assert {ask(url, listing(address)).status for address in others} == {200}
        assert [ask(url, listing("::ffff:192.0.2.2")).status for _ in range(2)] == [200, 429]  # an IPv4 address
        until(lambda: len(clients_in(tmp_path)) == 11)
        assert clients_in(tmp_path)[:4] == network


def test_addresses_of_an_ipv6_network_share_the_room_for_photos(model_path: Path, tmp_path: Path) -> None:
    flags = ("--trusted-proxies=127.0.0.1", "--max-queued-images=8", "--client-timeout-s=600")

    def forwarded(request: bytes, address: str) -> bytes:
        return request.replace(b"Host: x", b"Host: x\r\nX-Forwarded-For: " + address.encode())

    with hof_serve(tmp_path, model_path, *flags) as (url, _), ExitStack() as stack:
        for count in range(1, 7):
            connection = stack.enter_context(connect_to(url))
            connection.sendall(forwarded(UPLOAD, f"2001:db8::{count}") + 63 * b"a")
            until(lambda count=count: in_flight(url) == count)  # type: ignore[misc]
        refused = ask(url, forwarded(photo_request(), "2001:db8::99"))
        assert (refused.status, b"share" in refused.body) == (429, True)
        assert ask(url, forwarded(photo_request(), "2001:db8:0:1::99")).status == 201


@pytest.fixture
def url(model_path: Path, tmp_path: Path) -> Iterator[str]:
    """Run a server with room for eight photos, 3 MB of bodies and eight streams."""
    limits = ("--max-queued-images=8", "--max-upload-bytes=3000000", "--max-points-in-flight=3200000")
    with hof_serve(tmp_path, model_path, *limits, "--client-timeout-s=600") as (url, _):
        yield url


def in_flight(url: str) -> int:
    """Return how many requests are being answered, besides this one."""
    text = httpx.get(f"{url}/metrics", timeout=DEADLINE_S).text
    return int(float(text.split("\nhof_http_requests_in_flight ")[1].split()[0])) - 1


def test_uploads_count_as_they_arrive_not_as_declared(url: str) -> None:
    with ExitStack() as stack:
        for count in range(1, 6):  # which declare 5 MB
            stack.enter_context(connect_to(url)).sendall(UPLOAD + 100 * b"a")
            until(lambda count=count: in_flight(url) == count)  # type: ignore[misc]
        assert ask(url, photo_request()).status == 201


def test_uploads_that_have_arrived_keep_the_limit(url: str) -> None:
    with ExitStack() as stack:
        for index in range(3):
            source = f"127.0.0.{index + 1}"
            connection = stack.enter_context(connect_to(url, source))
            connection.sendall(UPLOAD + 700_000 * b"a")
            until(lambda index=index: in_flight(url) == index + 1)  # type: ignore[misc]
        until(lambda: ask(url, UPLOAD + 1_000_000 * b"a", source=OTHER).status == 429)


def test_client_that_drips_uploads_leaves_room_for_others(url: str) -> None:
    with ExitStack() as stack:
        for count in range(1, 7):
            stack.enter_context(connect_to(url)).sendall(UPLOAD + 63 * b"a")
            until(lambda count=count: in_flight(url) == count)  # type: ignore[misc]
        refused = ask(url, photo_request())
        assert (refused.status, b"share" in refused.body) == (429, True)
        assert ask(url, photo_request(), source=OTHER).status == 201


@pytest.mark.parametrize(
    ("large", "small"),
    [
        ("points?n=10000000&format=f32", "points?n=1000&format=f32"),
        ("mesh?resolution=100&format=obj", "mesh?resolution=16&format=obj"),
    ],
    ids=["points", "mesh"],
)
def test_client_that_reads_slowly_leaves_room_for_others(url: str, large: str, small: str) -> None:
    link = httpx.post(f"{url}/encode", content=PHOTO, timeout=DEADLINE_S).json()["links"]["self"]
    request = f"GET {link}/{large} HTTP/1.1\r\nHost: x\r\n\r\n".encode()
    statuses = []
    with ExitStack() as stack:
        for _ in range(40):
            connection = stack.enter_context(connect_to(url))
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_096)
            connection.sendall(request)
            statuses.append(connection.recv(12)[-3:])
            if statuses[-1] == b"429":
                break
        assert statuses[0] == b"200"
        assert statuses[-1] == b"429"
        request = f"GET {link}/{small} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n".encode()
        assert ask(url, request, source=OTHER).status == 200
