"""`AsyncClient`: the calls of `hof_client.calls`, sent by httpx for asyncio."""

import asyncio
from collections.abc import AsyncGenerator, AsyncIterator
from contextlib import asynccontextmanager
from types import TracebackType
from typing import Self, TypeVar

import httpx

from hof_client import calls
from hof_client.answers import StoredObject
from hof_client.connection import connection_of
from hof_client.methods import async_iterating, awaiting
from hof_client.problems import HofError
from hof_client.refusals import check_media_type, error_of, raising_ours
from hof_client.request import Call, Request, SizedT, Stream
from hof_client.retries import Attempts, Retry

T = TypeVar("T")


class AsyncClient:
    """A client of one service for asyncio. Its parameters and calls are those of `Client`; calls are awaited.

    Reading and writing local files blocks the event loop.
    """

    def __init__(
        self,
        base_url: str,
        *,
        api_key: str | None = None,
        timeout_s: float | None = 60.0,
        connect_timeout_s: float = 5.0,
        retry: Retry | None = None,
        transport: httpx.AsyncBaseTransport | None = None,
    ) -> None:
        self._retry = retry or Retry()
        connection = connection_of(base_url, api_key, timeout_s, connect_timeout_s)
        self._http = httpx.AsyncClient(**connection, transport=transport)

    encode = awaiting(calls.encode)
    encode_only = awaiting(calls.encode_only)
    encode_views = awaiting(calls.encode_views)
    encode_points = awaiting(calls.encode_points)
    encode_points_only = awaiting(calls.encode_points_only)
    import_object = awaiting(calls.import_object)
    objects = awaiting(calls.objects)
    object = awaiting(calls.object)
    set_label = awaiting(calls.set_label)
    delete = awaiting(calls.delete)
    compose = awaiting(calls.compose)
    interpolate = awaiting(calls.interpolate)
    compose_all = awaiting(calls.compose_all)

    points = awaiting(calls.points)
    iter_points = async_iterating(calls.iter_points)
    colored_points = awaiting(calls.colored_points)
    save_points = awaiting(calls.save_points)
    mesh = awaiting(calls.mesh)
    picture = awaiting(calls.picture)
    photo = awaiting(calls.photo)
    weights = awaiting(calls.weights)
    path = awaiting(calls.path)
    path_file = awaiting(calls.path_file)
    theta = awaiting(calls.theta)

    models = awaiting(calls.models)
    model = awaiting(calls.model)
    live = awaiting(calls.live)
    ready = awaiting(calls.ready)
    metrics = awaiting(calls.metrics)

    inference_server = awaiting(calls.inference_server)
    inference_live = awaiting(calls.inference_live)
    inference_ready = awaiting(calls.inference_ready)
    inference_model = awaiting(calls.inference_model)
    inference_config = awaiting(calls.inference_config)
    inference_model_ready = awaiting(calls.inference_model_ready)
    infer = awaiting(calls.infer)

    async def iter_objects(self) -> AsyncGenerator[StoredObject, None]:
        """Iterate over all objects, newest first, a page at a time."""
        cursor = None
        while True:
            page = await self.objects(limit=calls.MAX_LIMIT, cursor=cursor)
            for item in page.items:
                yield item
            cursor = page.next
            if cursor is None:
                return

    async def send(self, call: Call[T]) -> T:
        """Send a call, with repeats, and return its answer. Raises HofError."""
        attempts = Attempts(self._retry, is_repeatable=call.request.is_repeatable)
        while True:
            try:
                return await self._send_once(call)
            except HofError as error:
                wait_s = attempts.wait_s(error)
            await asyncio.sleep(wait_s)

    async def iterate(self, stream: Stream[SizedT]) -> AsyncGenerator[SizedT, None]:
        """Send a call and yield the pieces of its answer as they come; there are no repeats from the first piece on."""
        attempts = Attempts(self._retry, is_repeatable=stream.request.is_repeatable)
        while True:
            try:
                async with self._answer(stream.request) as response:
                    chunks = stream.chunks()
                    async for data in response.aiter_bytes():
                        if len(piece := chunks.feed(data)):
                            attempts.end()
                            yield piece
                    chunks.end()
                    return
            except HofError as error:
                wait_s = attempts.wait_s(error)
            await asyncio.sleep(wait_s)

    async def _send_once(self, call: Call[T]) -> T:
        async with self._answer(call.request) as response:
            reader = call.read(response.headers)
            try:
                async for data in response.aiter_bytes():
                    reader.feed(data)
                return reader.result()
            finally:
                reader.close()

    @asynccontextmanager
    async def _answer(self, request: Request) -> AsyncIterator[httpx.Response]:
        """Send a request and pass its answer on when its head is there. Raises HofError for one that is an error."""
        with raising_ours():
            async with self._http.stream(
                request.method,
                request.path,
                params=request.parameters,
                content=request.content,
                headers=request.headers,
            ) as response:
                with raising_ours(is_answered=True):
                    if not response.is_success:
                        await response.aread()
                        raise error_of(response)
                    check_media_type(response, request.media_type)
                    yield response

    async def aclose(self) -> None:
        """Close the connections."""
        await self._http.aclose()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.aclose()

    def __repr__(self) -> str:
        return f"{type(self).__name__}({str(self._http.base_url)!r})"
