"""A service in color, and both clients of it behind the blocking interface, so that each test runs for both."""

import asyncio
import inspect
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path
from typing import cast

import pytest

from hof_client import AsyncClient, Client, Retry, StoredObject
from service.settings import Settings
from tests.support.photos import disc, image_file
from tests.support.server import Open, Server, running


class Blocking:
    """An `AsyncClient` whose calls block and whose iterations are lists."""

    def __init__(self, client: AsyncClient) -> None:
        self._runner = asyncio.Runner()
        self._client = client

    def __getattr__(self, name: str) -> Callable[..., object]:
        method = getattr(self._client, name)

        def blocking(*args: object, **kwargs: object) -> object:
            answer = method(*args, **kwargs)
            return iter(self._runner.run(_listed(answer))) if inspect.isasyncgen(answer) else self._runner.run(answer)

        return blocking

    def close(self) -> None:
        self._runner.run(self._client.aclose())
        self._runner.close()


async def _listed(items: AsyncIterator[object]) -> list[object]:
    return [item async for item in items]


@pytest.fixture(params=["Client", "AsyncClient"])
def connect(request: pytest.FixtureRequest) -> Iterator[Open]:
    """Return what opens a client: of either class, so that each test runs for both."""
    opened: list[Client] = []

    def connect(url: str, *, api_key: str | None = None, retry: Retry | None = None, timeout_s: float = 60) -> Client:
        if request.param == "Client":
            client = Client(url, api_key=api_key, retry=retry, timeout_s=timeout_s)
        else:
            waiting = AsyncClient(url, api_key=api_key, retry=retry, timeout_s=timeout_s)
            client = cast(Client, Blocking(waiting))
        opened.append(client)
        return client

    yield connect
    for client in opened:
        client.close()


@pytest.fixture(scope="module")
def colored_server(colored_path: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """Run a service whose model has color, for the tests of a module."""
    store = f"sqlite:///{tmp_path_factory.mktemp('store') / 'hof.db'}"
    with running(Settings(model=(colored_path,), database_url=store, threads=2)) as server:
        yield server


@pytest.fixture
def hof(connect: Open, colored_server: Server) -> Client:
    """Open a client of the service in color."""
    return connect(f"http://127.0.0.1:{colored_server.port}")


@pytest.fixture
def disc_object(hof: Client) -> StoredObject:
    return hof.encode(image_file(disc()))
