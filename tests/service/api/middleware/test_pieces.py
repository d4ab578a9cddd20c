"""Bodies are sent in pieces, and held in a gate until the last one is taken."""

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import pytest
from starlette.responses import Response, StreamingResponse
from starlette.types import Message

from service.api.context import RequestContext, attach
from service.api.middleware.pieces import PIECE, SendInPieces
from service.runtime.admission import Gate

BODY = bytes(range(256)) * 1_000


def _send(response: Response, gate: Gate, *, is_head: bool = False) -> list[tuple[Message, int]]:
    """Send a response through the layer; return its messages, each with what the gate held meanwhile."""
    sent: list[tuple[Message, int]] = []
    scope: dict[str, Any] = {
        "type": "http",
        "method": "GET",
        "path": "/",
        "headers": [],
        "asgi": {"spec_version": "2.4"},
    }
    attach(scope, RequestContext(None, is_head=is_head))

    async def receive() -> Message:
        return {"type": "http.request"}

    async def send(message: Message) -> None:
        sent.append((message, gate.held))

    asyncio.run(SendInPieces(response, gate)(scope, receive, send))
    return sent


def _body(sent: list[tuple[Message, int]]) -> bytes:
    return b"".join(message.get("body", b"") for message, _ in sent)


@pytest.mark.parametrize("size", [0, 1, PIECE, PIECE + 1, 2 * PIECE, len(BODY)])
def test_body_is_sent_whole_in_pieces(size: int) -> None:
    sent = _send(Response(BODY[:size]), Gate("bytes", 1))
    assert _body(sent) == BODY[:size]
    assert max(len(message.get("body", b"")) for message, _ in sent) <= PIECE
    assert [message.get("more_body", False) for message, _ in sent[1:]] == [True] * (len(sent) - 2) + [False]
    assert all(message["body"] for message, _ in sent[1:]) or not size  # the end comes with the last bytes


def test_large_body_is_held_until_its_last_piece_is_taken() -> None:
    gate = Gate("bytes", 1)
    assert {held for _, held in _send(Response(BODY), gate)} == {len(BODY)}
    assert (gate.held, gate.finished) == (0, 1)


@pytest.mark.parametrize("is_head", [False, True])
def test_small_body_and_head_are_not_held(is_head: bool) -> None:
    body = BODY if is_head else BODY[:PIECE]
    assert {held for _, held in _send(Response(body), Gate("bytes", 1), is_head=is_head)} == {0}


def test_large_body_without_room_is_answered_429() -> None:
    gate = Gate("bytes", len(BODY))
    with gate.admit():
        sent = _send(Response(BODY), gate)
    assert sent[0][0]["status"] == 429
    assert b"bytes" in _body(sent)


def test_stream_is_sent_in_pieces_and_not_held() -> None:
    async def parts() -> AsyncIterator[bytes]:
        yield BODY
        yield BODY

    sent = _send(StreamingResponse(parts()), Gate("bytes", 1))
    assert _body(sent) == 2 * BODY
    assert all(message["body"] for message, _ in sent[1:-1])
    assert max(len(message.get("body", b"")) for message, _ in sent) <= PIECE
    assert {held for _, held in sent} == {0}
