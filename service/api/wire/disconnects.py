"""Clients that leave or stall: their work ends. What is queued for them is never begun."""

import asyncio
import time
from collections.abc import AsyncIterator, Coroutine, Mapping
from contextlib import suppress
from typing import Any, Final, TypeVar

from starlette.requests import ClientDisconnect, Request
from starlette.responses import StreamingResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.errors import Stalled
from service.runtime.admission import Gate

R = TypeVar("R")

SLOWEST_UPLOAD: Final = 8_192  # bytes a second, of a body once it has had the longest wait for its first ones


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
        if not task.done():
            await asyncio.wait((task,))  # a worker thread that has begun: what it takes stays counted until it ends


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


class Patience:
    """Ends a request whose client does not send the next bytes of its body in time, or a few at a time only, or does
    not take those of its answer.

    It would keep what a gate lets in from others. In the call, `receive` then raises Stalled and `send`
    ClientDisconnect.
    """

    def __init__(self, app: ASGIApp, seconds: float) -> None:
        self._app = app
        self._seconds = seconds

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, with a limit on each wait for the client."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        began, received, body_ended = time.monotonic(), 0, False

        async def receive_in_time() -> Message:
            nonlocal received, body_ended
            if body_ended:  # what comes now is that the client leaves
                return await receive()
            left_s = began + self._seconds + received / SLOWEST_UPLOAD - time.monotonic()
            try:
                async with asyncio.timeout(min(self._seconds, left_s)):
                    message = await receive()
            except TimeoutError:
                slow = f"no byte of the body came for {self._seconds:g} s, or fewer than {SLOWEST_UPLOAD} a second"
                raise Stalled(slow) from None
            received += len(message.get("body", b""))
            body_ended = not message.get("more_body", False)
            return message

        async def send_in_time(message: Message) -> None:
            try:
                async with asyncio.timeout(self._seconds):
                    await send(message)
            except TimeoutError:
                raise ClientDisconnect from None

        await self._app(scope, receive_in_time, send_in_time)
