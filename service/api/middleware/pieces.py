"""Answers in pieces, so that clients that do not read hold a bounded amount of memory."""

import asyncio
from typing import Final

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.api.context import client_of, context_of
from service.api.problems import respond
from service.errors import Overloaded
from service.runtime.admission import Gate

PIECE: Final = 65_536  # bytes; the server waits for its client once it holds more than these


class SendInPieces:
    """Send bodies in pieces, each after the client has taken the one before, and hold whole bodies in a gate.

    The server copies what it is given to send, at once and of any size. So a body that is complete in memory counts
    in the gate until its client has taken it; one that the gate has no room for is answered 429. Streams are admitted
    by their routes.
    """

    def __init__(self, app: ASGIApp, gate: Gate) -> None:
        self._app = app
        self._gate = gate

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and send its answer in pieces."""
        if scope["type"] != "http" or context_of(scope).is_head:
            await self._app(scope, receive, send)
            return
        start: Message | None = None  # kept back until the size of the body is known

        async def send_in_pieces(message: Message) -> None:
            nonlocal start
            if message["type"] == "http.response.start":
                start = message
                return
            body, is_whole = message.get("body", b""), start is not None and not message.get("more_body", False)
            if is_whole and len(body) > PIECE:
                try:
                    with self._gate.admit(len(body), client_of(scope)):
                        await send_all(message)
                except Overloaded as error:
                    await respond(error)(scope, receive, send)
            else:
                await send_all(message)

        async def send_all(message: Message) -> None:
            nonlocal start
            if start is not None:
                await send(start)
                start = None
            body = message.get("body", b"")
            # The last piece is sent with the end of the answer: a client that knows the length may then ask again.
            last = max(0, len(body) - 1) // PIECE * PIECE
            for begin in range(0, last, PIECE):
                await send({"type": message["type"], "body": body[begin : begin + PIECE], "more_body": True})
                await asyncio.sleep(0)  # others' turn, and that of whoever watches for the client to leave
            await send({**message, "body": body[last:]})

        await self._app(scope, receive, send_in_pieces)
