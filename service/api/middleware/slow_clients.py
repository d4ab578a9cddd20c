"""Timeout for clients that send too slowly. `service.server.unread_answers` has the one for those that read slowly."""

import asyncio
import time
from typing import Final

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from service.errors import Stalled

MIN_RATE: Final = 8_192  # bytes a second, on average over a body, of the request or of the answer


class SlowClientTimeout:
    """End a request whose client is too slow, because it holds room in the gates that others need.

    A client is too slow if it sends no byte of its body for `seconds`, or if its body arrives at less than
    `MIN_RATE` after the first `seconds`. For the application, `receive` then raises Stalled.
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

        await self._app(scope, receive_in_time, send)
