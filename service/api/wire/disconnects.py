"""Clients that leave: their work is canceled, and work still queued for them never starts."""

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine, Mapping
from contextlib import suppress
from typing import Any, TypeVar

from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response, StreamingResponse
from starlette.types import Receive, Scope, Send

from service.api.context import client_of
from service.runtime.admission import ClientLeft, Gate

R = TypeVar("R")


async def while_connected(request: Request, work: Coroutine[Any, Any, R]) -> R:
    """Await work as long as its client is connected. The body of the request must have been read, or be empty.

    Raises
    ------
    ClientLeft : the client disconnected; the work is canceled, and calls still queued for a worker thread never run.
    """
    task = asyncio.ensure_future(work)
    departure = asyncio.ensure_future(_disconnect(request.receive))
    try:
        await asyncio.wait((task, departure), return_when=asyncio.FIRST_COMPLETED)
        if not task.done():
            raise ClientLeft
        return task.result()
    finally:
        task.cancel()
        departure.cancel()
        if not task.done():
            await asyncio.wait((task,))  # a worker thread that has begun: its work stays counted until it ends


async def _disconnect(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass


class AdmittedStream(StreamingResponse):
    """A stream that holds an amount of a gate from before its first byte until its last, or until its client leaves.

    Raises Overloaded, and what `begin` raises, when it is sent, which is early enough for another answer.

    Parameters
    ----------
    begin : reads what the stream needs, within the gate, and returns its pieces.
    """

    def __init__(
        self,
        begin: Callable[[], Awaitable[AsyncIterator[bytes]]],
        gate: Gate,
        amount: int,
        headers: Mapping[str, str],
        media_type: str,
    ) -> None:
        super().__init__((), headers=headers, media_type=media_type)
        self._begin = begin
        self._gate = gate
        self._amount = amount
        self._is_complete = False

    async def stream_response(self, send: Send) -> None:
        """Send head and pieces."""
        await super().stream_response(send)
        self._is_complete = True

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send the answer, within the gate."""
        with suppress(ClientLeft), self._gate.admit(self._amount, client_of(scope)):
            self.body_iterator = await self._begin()
            with suppress(ClientDisconnect):
                await super().__call__(scope, receive, send)
            if not self._is_complete:
                raise ClientLeft


class AdmittedFile(Response):
    """A file that holds an amount of a gate from before it is computed until its client has taken it, or leaves.

    Raises Overloaded, and what the computation raises, when it is sent, which is early enough for another answer.
    """

    def __init__(
        self,
        compute: Callable[[], Coroutine[Any, Any, bytes]],
        gate: Gate,
        amount: int,
        headers: Mapping[str, str],
        media_type: str,
    ) -> None:
        super().__init__(headers=headers, media_type=media_type)
        self._compute = compute
        self._gate = gate
        self._amount = amount
        self._file_headers = headers

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Compute the file and send it, within the gate."""
        with suppress(ClientLeft), self._gate.admit(self._amount, client_of(scope)):
            try:
                await while_connected(Request(scope, receive), self._compute_and_send(scope, receive, send))
            except ClientDisconnect as error:
                raise ClientLeft from error

    async def _compute_and_send(self, scope: Scope, receive: Receive, send: Send) -> None:
        response = Response(await self._compute(), headers=self._file_headers, media_type=self.media_type)
        await response(scope, receive, send)
