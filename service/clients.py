"""Clients that leave: their work ends. What is queued for them is never begun."""

import asyncio
from collections.abc import AsyncIterator, Coroutine, Mapping
from contextlib import suppress
from typing import Any, TypeVar

from starlette.requests import ClientDisconnect, Request
from starlette.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from service.admission import Gate

R = TypeVar("R")


async def while_there(request: Request, work: Coroutine[Any, Any, R]) -> R:
    """Await what a client waits for; its body must have been read, or it must have none.

    Raises
    ------
    ClientDisconnect : it left; the work is cancelled, and what waits for a worker thread never runs.
    """
    task = asyncio.ensure_future(work)
    gone = asyncio.ensure_future(_departure(request.receive))
    try:
        await asyncio.wait((task, gone), return_when=asyncio.FIRST_COMPLETED)
        if not task.done():
            raise ClientDisconnect
        return task.result()
    finally:
        task.cancel()
        gone.cancel()


async def _departure(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass


class AdmittedStream(StreamingResponse):
    """A stream that a gate lets in before its first byte and holds until its last, or until the client leaves.

    Raises Overloaded when it is sent, which is early enough for another answer.
    """

    def __init__(
        self, pieces: AsyncIterator[bytes], gate: Gate, amount: int, headers: Mapping[str, str], media_type: str
    ) -> None:
        super().__init__(pieces, headers=headers, media_type=media_type)
        self._gate = gate
        self._amount = amount
        self._sent_all = False

    async def stream_response(self, send: Send) -> None:
        """Send head and pieces."""
        await super().stream_response(send)
        self._sent_all = True

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer, within the gate."""
        with suppress(ClientDisconnect), self._gate.admit(self._amount):
            await super().__call__(scope, receive, send)
            if not self._sent_all:
                raise ClientDisconnect
