"""`Client`: the calls of `hof_client.calls`, sent by httpx.

A call is a value: a request, and the reader of its answer. So each call is written once. `AsyncClient` differs only in
how it sends one: the loops of this class are all that exists twice.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Self, TypeVar

import httpx

from hof_client import calls
from hof_client.answers import StoredObject
from hof_client.connection import connection_of
from hof_client.methods import iterating, sending
from hof_client.problems import HofError
from hof_client.refusals import check_media_type, error_of, raising_ours
from hof_client.request import Call, Request, SizedT, Stream
from hof_client.retries import Attempts, Retry

T = TypeVar("T")


class Client:
    """A client of one service. Close it, or use it in a `with` block; threads may share it.

    Parameters
    ----------
    base_url : of the service, for example `http://localhost:8080`; behind a proxy, with its prefix.
    api_key : sent as `Authorization: Bearer`; None for a service without keys.
    timeout_s : seconds without any byte of an answer after which a call fails with `TimedOut`; None for no limit.
    connect_timeout_s : seconds after which a connection counts as failed.
    retry : limits on the repeats of a call; by default those of `Retry()`.
    transport : httpx's, for certificates and proxies of your own.
    """

    def __init__(
        self,
        base_url: str,
        *,
        api_key: str | None = None,
        timeout_s: float | None = 60.0,
        connect_timeout_s: float = 5.0,
        retry: Retry | None = None,
        transport: httpx.BaseTransport | None = None,
    ) -> None:
        self._retry = retry or Retry()
        connection = connection_of(base_url, api_key, timeout_s, connect_timeout_s)
        self._http = httpx.Client(**connection, transport=transport)

    encode = sending(calls.encode)
    encode_only = sending(calls.encode_only)
    encode_views = sending(calls.encode_views)
    encode_points = sending(calls.encode_points)
    encode_points_only = sending(calls.encode_points_only)
    import_object = sending(calls.import_object)
    objects = sending(calls.objects)
    object = sending(calls.object)
    set_label = sending(calls.set_label)
    delete = sending(calls.delete)
    compose = sending(calls.compose)
    interpolate = sending(calls.interpolate)
    compose_all = sending(calls.compose_all)

    points = sending(calls.points)
    iter_points = iterating(calls.iter_points)
    colored_points = sending(calls.colored_points)
    save_points = sending(calls.save_points)
    mesh = sending(calls.mesh)
    picture = sending(calls.picture)
    photo = sending(calls.photo)
    weights = sending(calls.weights)
    path = sending(calls.path)
    path_file = sending(calls.path_file)
    theta = sending(calls.theta)

    models = sending(calls.models)
    model = sending(calls.model)
    live = sending(calls.live)
    ready = sending(calls.ready)
    metrics = sending(calls.metrics)

    inference_server = sending(calls.inference_server)
    inference_live = sending(calls.inference_live)
    inference_ready = sending(calls.inference_ready)
    inference_model = sending(calls.inference_model)
    inference_config = sending(calls.inference_config)
    inference_model_ready = sending(calls.inference_model_ready)
    infer = sending(calls.infer)

    def iter_objects(self) -> Iterator[StoredObject]:
        """Iterate over all objects, newest first, a page at a time."""
        cursor = None
        while True:
            page = self.objects(limit=calls.MAX_LIMIT, cursor=cursor)
            yield from page.items
            cursor = page.next
            if cursor is None:
                return

    def send(self, call: Call[T]) -> T:
        """Send a call, with repeats, and return its answer. Raises HofError."""
        attempts = Attempts(self._retry, is_repeatable=call.request.is_repeatable)
        while True:
            try:
                return self._send_once(call)
            except HofError as error:
                wait_s = attempts.wait_s(error)
            time.sleep(wait_s)

    def iterate(self, stream: Stream[SizedT]) -> Iterator[SizedT]:
        """Send a call and yield the pieces of its answer as they come; there are no repeats from the first piece on."""
        attempts = Attempts(self._retry, is_repeatable=stream.request.is_repeatable)
        while True:
            try:
                with self._answer(stream.request) as response:
                    chunks = stream.chunks()
                    for data in response.iter_bytes():
                        if len(piece := chunks.feed(data)):
                            attempts.end()
                            yield piece
                    chunks.end()
                    return
            except HofError as error:
                wait_s = attempts.wait_s(error)
            time.sleep(wait_s)

    def _send_once(self, call: Call[T]) -> T:
        with self._answer(call.request) as response:
            reader = call.read(response.headers)
            try:
                for data in response.iter_bytes():
                    reader.feed(data)
                return reader.result()
            finally:
                reader.close()

    @contextmanager
    def _answer(self, request: Request) -> Iterator[httpx.Response]:
        """Send a request and pass its answer on when its head is there. Raises HofError for one that is an error."""
        with (
            raising_ours(),
            self._http.stream(
                request.method,
                request.path,
                params=request.parameters,
                content=request.content,
                headers=request.headers,
            ) as response,
            raising_ours(is_answered=True),
        ):
            if not response.is_success:
                response.read()
                raise error_of(response)
            check_media_type(response, request.media_type)
            yield response

    def close(self) -> None:
        """Close the connections."""
        self._http.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"{type(self).__name__}({str(self._http.base_url)!r})"
