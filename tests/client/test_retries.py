"""Repeats: as often and as late as the service and the settings say, and no more."""

import time
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy.exc import OperationalError

from hof_client import (
    AsyncClient,
    Client,
    ConnectionFailed,
    HofError,
    NotReady,
    RateLimited,
    Retry,
    TimedOut,
    Truncated,
    TryLater,
    UnexpectedAnswer,
    Unreachable,
)
from hof_client.problems import InvalidParameter
from hof_client.retries import Attempts
from service.settings import Settings
from tests.client.scripted import answer, scripted
from tests.support.server import Open, Server, running

NEVER = Retry(times=0)
SOON = Retry(first_s=0.01)
LIVE = answer("200 OK", b'{"status":"live"}', Content_Type="application/json")
BUSY = answer("429 Too Many Requests", Retry_After="0")
RAW = "application/octet-stream"
POINTS = np.arange(30, dtype=np.float32).reshape(10, 3)


def test_call_over_the_rate_limit_succeeds_once_the_service_allows_it(connect: Open, settings: Settings) -> None:
    with running(settings.model_copy(update={"rate_limit": "2/second"})) as server:
        url = f"http://127.0.0.1:{server.port}"
        impatient, patient = connect(url, retry=NEVER), connect(url)
        with pytest.raises(RateLimited, match="more than 2 requests") as caught:
            [impatient.models() for _ in range(20)]
        assert caught.value.retry_after_s == 1
        start = time.monotonic()
        assert patient.models().models
        assert time.monotonic() - start >= 1


def test_service_that_is_not_ready_is_asked_again(
    connect: Open, server: Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    pings: list[float] = []

    async def broken_once(*_: object) -> None:
        pings.append(time.monotonic())
        if len(pings) == 1:
            raise OperationalError("SELECT 1", {}, OSError("gone"))

    monkeypatch.setattr("service.storage.store.Store.ping", broken_once)
    url = f"http://127.0.0.1:{server.port}"
    with pytest.raises(NotReady, match="store does not answer") as caught:
        connect(url, retry=NEVER).ready()
    assert caught.value.retry_after_s == 1
    pings.clear()
    assert connect(url).ready().status == "ready"
    assert pings[1] - pings[0] >= 1


@pytest.mark.parametrize("first", [b"", BUSY, answer("503 Service Unavailable"), answer("502 Bad Gateway"), LIVE[:-5]])
def test_failed_call_is_repeated(connect: Open, first: bytes) -> None:
    with scripted(first, first, LIVE) as server:
        assert connect(server.url, retry=SOON).live().status == "live"
        assert len(server.requests) == 3


def test_post_is_repeated_with_its_body(connect: Open) -> None:
    with scripted(b"", LIVE) as server, pytest.raises(UnexpectedAnswer, match="id is missing"):
        connect(server.url, retry=SOON).compose(["a", "b"])
    assert [request.partition(b" HTTP")[0] for request in server.requests] == [b"POST /compose"] * 2


@pytest.mark.parametrize(
    ("status", "kind"),
    [("400 Bad Request", "InvalidInput"), ("500 Internal Server Error", "Problem"), ("302 Found", "UnexpectedAnswer")],
)
def test_refused_call_is_not_repeated(connect: Open, status: str, kind: str) -> None:
    with scripted(answer(status)) as server, pytest.raises(HofError) as caught:
        connect(server.url, retry=SOON).live()
    assert type(caught.value).__name__ == kind


def test_repeats_end_after_their_number(connect: Open) -> None:
    with scripted(BUSY, BUSY, BUSY) as server, pytest.raises(TryLater, match="429"):
        connect(server.url, retry=Retry(times=2, first_s=0.01)).live()


def test_longer_wait_than_the_total_is_an_error_at_once(connect: Open) -> None:
    start = time.monotonic()
    with scripted(answer("503 Service Unavailable", Retry_After="61")) as server, pytest.raises(TryLater) as caught:
        connect(server.url).live()
    assert caught.value.retry_after_s == 61
    assert time.monotonic() - start < 30


def test_date_of_retry_after_is_waited_for(connect: Open) -> None:
    date = datetime.now(UTC).replace(microsecond=0) + timedelta(seconds=2)
    busy = answer("503 Service Unavailable", Retry_After=format_datetime(date, usegmt=True))
    with scripted(busy, LIVE) as server:
        assert connect(server.url).live().status == "live"
    assert datetime.now(UTC) >= date


def test_delete_is_repeated_only_if_it_was_not_carried_out(connect: Open) -> None:
    gone = answer("204 No Content")
    with scripted(BUSY, gone) as server:
        assert connect(server.url, retry=SOON).delete("a") is None
    with scripted(b"") as server, pytest.raises(ConnectionFailed):
        connect(server.url, retry=SOON).delete("a")


def test_unreachable_service_is_an_error_that_names_it(connect: Open) -> None:
    with scripted() as server:
        url = server.url
    with pytest.raises(Unreachable, match=url):
        connect(url, retry=Retry(times=1, first_s=0.01)).live()


def test_silent_service_times_out_without_a_repeat(connect: Open) -> None:
    with scripted(None) as server, pytest.raises(TimedOut, match="timeout_s"):
        connect(server.url, retry=SOON, timeout_s=0.2).live()


def test_points_that_break_off_are_asked_for_again(connect: Open) -> None:
    whole = answer("200 OK", POINTS.tobytes(), Content_Type=RAW)
    with scripted(whole[:-50], whole) as server:
        assert np.array_equal(connect(server.url, retry=SOON).points("a", 10), POINTS)


@pytest.mark.parametrize("cut", [1, 12, 119])
def test_points_that_always_break_off_are_refused(connect: Open, cut: int) -> None:
    claimed = answer("200 OK", POINTS.tobytes()[:-cut], length=120, Content_Type=RAW)
    unclaimed = answer("200 OK", POINTS.tobytes()[:-cut], Content_Type=RAW)
    for piece in (claimed, unclaimed):
        with scripted(piece, piece) as server, pytest.raises(Truncated):
            connect(server.url, retry=Retry(times=1, first_s=0.01)).points("a", 10)


def test_file_that_breaks_off_is_removed(connect: Open, tmp_path: Path) -> None:
    piece = answer("200 OK", b"1 2 3\n", length=100, Content_Type="text/plain")
    with scripted(piece) as server, pytest.raises(Truncated):
        connect(server.url, retry=NEVER).save_points("a", tmp_path / "a.xyz", 10)
    assert list(tmp_path.iterdir()) == []


def test_iteration_repeats_only_before_the_first_points() -> None:
    whole = answer("200 OK", POINTS.tobytes(), Content_Type=RAW)
    with scripted(BUSY, whole) as server, Client(server.url, retry=SOON) as client:
        assert np.array_equal(np.concatenate(list(client.iter_points("a", 10))), POINTS)
    with scripted(whole[:-50]) as server, Client(server.url, retry=SOON) as client:
        chunks = client.iter_points("a", 10)
        assert np.array_equal(next(chunks), POINTS[:5])
        with pytest.raises(Truncated):
            next(chunks)


def test_other_service_is_recognized(connect: Open) -> None:
    page = answer("200 OK", b"<html>", Content_Type="text/html; charset=utf-8")
    for name in ("live", "models"):
        with scripted(page) as server, pytest.raises(UnexpectedAnswer, match="text/html instead of application/json"):
            getattr(connect(server.url), name)()


@pytest.mark.parametrize("body", [b"", b"{", b"[]", b'{"status":1}', b"\xff"])
def test_answer_that_is_not_the_documented_one_is_refused(connect: Open, body: bytes) -> None:
    faulty = answer("200 OK", body, Content_Type="application/json")
    with scripted(faulty) as server, pytest.raises(UnexpectedAnswer, match="not as documented"):
        connect(server.url).live()


def test_waits_double_up_to_the_longest_and_are_partly_random() -> None:
    attempts = Attempts(Retry(times=5, first_s=1, longest_s=4))
    waits = [attempts.wait_s(ConnectionFailed("x")) for _ in range(5)]
    assert all(most / 2 <= wait <= most for wait, most in zip(waits, (1, 2, 4, 4, 4), strict=True))
    with pytest.raises(ConnectionFailed):
        attempts.wait_s(ConnectionFailed("x"))
    firsts = {Attempts(Retry()).wait_s(ConnectionFailed("x")) for _ in range(20)}
    assert len(firsts) > 10


def test_wait_is_never_shorter_than_the_service_says() -> None:
    busy = TryLater("x", status=429)
    busy.retry_after_s = 7
    waits = [Attempts(Retry()).wait_s(busy) for _ in range(50)]
    assert 7 <= min(waits) < max(waits) <= 8


def test_attempt_after_the_total_is_not_started(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [0.0]
    monkeypatch.setattr("hof_client.retries.time.monotonic", lambda: now[0])
    attempts = Attempts(Retry(times=100, total_s=10, first_s=1, longest_s=1))
    attempts.wait_s(ConnectionFailed("x"))
    now[0] = 9.6
    with pytest.raises(ConnectionFailed):
        attempts.wait_s(ConnectionFailed("x"))


@pytest.mark.parametrize("error", [TimedOut("x"), UnexpectedAnswer("x"), InvalidParameter("x")])
def test_error_that_a_repeat_does_not_help_is_raised(error: HofError) -> None:
    with pytest.raises(type(error)):
        Attempts(Retry()).wait_s(error)


def test_clients_close_at_the_end_of_their_block() -> None:
    with scripted(LIVE) as server, Client(server.url) as client:
        client.live()
    with pytest.raises(RuntimeError, match="closed"):
        client.live()
    assert repr(client).startswith("Client('http://127.0.0.1")
    assert repr(AsyncClient("http://localhost")).startswith("AsyncClient('http://localhost")
