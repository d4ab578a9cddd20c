"""Clients that are slow but never silent."""

import asyncio

import pytest
from starlette.requests import ClientDisconnect
from starlette.types import Message, Receive, Scope, Send

from service.api.middleware.slow_clients import MIN_RATE, SlowClientTimeout

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


def taken(size: int, client_s: float, server_s: float) -> bool:
    """Return whether an answer is sent to its end to a client that takes each message in `client_s`."""

    async def answer(scope: Scope, receive: Receive, send: Send) -> None:
        for _ in range(MESSAGES):
            await asyncio.sleep(server_s)
            await send({"type": "http.response.body", "body": bytes(size), "more_body": True})

    async def send(message: Message) -> None:
        await asyncio.sleep(client_s)

    async def receive() -> Message:
        return {"type": "http.disconnect"}

    async def run() -> bool:
        try:
            await SlowClientTimeout(answer, SECONDS)({"type": "http"}, receive, send)
        except ClientDisconnect:
            return False
        return True

    return asyncio.run(run())
