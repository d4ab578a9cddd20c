"""Clients that read slowly, but are never silent."""

import asyncio

import pytest

from service.api.middleware.slow_clients import MIN_RATE
from service.server.unread_answers import ReaderTimer

SECONDS = 0.2
MESSAGES = 12


@pytest.mark.parametrize(
    ("size", "server_s", "ends"),
    [(100, 0.0, True), (MIN_RATE, 0.0, False), (100, 0.1, True)],
    ids=["slow", "fast enough", "slow, and the service too"],
)
def test_answer_that_is_taken_too_slowly_ends(size: int, server_s: float, ends: bool) -> None:
    assert taken(size, client_s=0.05, server_s=server_s) is not ends


def test_answer_that_the_service_computes_slowly_goes_on() -> None:
    assert taken(100, client_s=0.0, server_s=0.05)


def test_slow_answer_after_a_fast_one_ends() -> None:
    assert not taken(100, client_s=0.05, server_s=0.0, before=100 * MIN_RATE)


def taken(size: int, client_s: float, server_s: float, before: int = 0) -> bool:
    """Return whether an answer goes out to its end to a client that takes each message in `client_s`.

    The answer before, on the same connection, had `before` bytes, which the client took at once.
    """

    async def run() -> bool:
        ended = asyncio.Event()
        timer = ReaderTimer(SECONDS, ended.set)
        timer.start(before)
        timer.stop(0)
        timer.begin_answer()
        for _ in range(MESSAGES):
            await asyncio.sleep(server_s)
            timer.start(size)
            await asyncio.sleep(client_s)
            if ended.is_set():
                return False
            timer.stop(0)
        return True

    return asyncio.run(run())
