"""Timeouts for clients that send or receive too slowly."""

import asyncio
import time
from typing import Final

from starlette.requests import ClientDisconnect
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.errors import Stalled

MIN_RATE: Final = 8_192  # bytes a second, on average over a body, of the request or of the answer


class SlowClientTimeout:
    """End a request whose client is too slow, because it holds room in the gates that others need.

    A client is too slow if it sends no byte of its body for `seconds`, if its body arrives at less than
    `MIN_RATE` after the first `seconds`, if it does not take the next bytes of the answer within `seconds`, or if it
    takes them at less than `MIN_RATE`, not counting the time in which the service computes them.
    For the application, `receive` then raises Stalled and `send` raises ClientDisconnect.
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
        sent, waited_s = 0, 0.0

        async def receive_in_time() -> Message:
            nonlocal received, body_ended
            if body_ended:  # the next message is the disconnect, which may come at any time
                return await receive()
            left_s = began + self._seconds + received / MIN_RATE - time.monotonic()
            try:
                async with asyncio.timeout(min(self._seconds, left_s)):
                    message = await receive()
            except TimeoutError:
                raise Stalled(
                    f"the body came too slowly: no byte for {self._seconds:g} s, or fewer than {MIN_RATE} a second"
                ) from None
            received += len(message.get("body", b""))
            body_ended = not message.get("more_body", False)
            return message

        async def send_in_time(message: Message) -> None:
            nonlocal sent, waited_s
            start, left_s = time.monotonic(), self._seconds + sent / MIN_RATE - waited_s
            try:
                async with asyncio.timeout(min(self._seconds, left_s)):
                    await send(message)
            except TimeoutError:
                raise ClientDisconnect from None
            waited_s += time.monotonic() - start
            sent += len(message.get("body", b""))

        await self._app(scope, receive_in_time, send_in_time)
