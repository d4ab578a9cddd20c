"""BentoML: a plain service with one worker, which computes on a thread; without its adaptive batching."""

import asyncio
import os
from concurrent.futures import ThreadPoolExecutor
from typing import Annotated, Any

import bentoml
from bentoml.validators import ContentType

from benchmarks.load.peers.work import Work
from service.storage.store import Store


@bentoml.service(workers=1, traffic={"timeout": 60}, logging={"access": {"enabled": False}})
class Peer:
    """Server that turns a photo into a stored theta."""

    def __init__(self) -> None:
        self._work = Work()
        self._executor = ThreadPoolExecutor(1)
        self._store: Store | None = None

    @bentoml.api(route="/encode")  # type: ignore[untyped-decorator]
    async def encode(self, image: Annotated[bytes, ContentType("image/jpeg")], /) -> dict[str, Any]:
        """Encode the raw body and store the object."""
        if self._store is None:
            self._store = await Store.open(os.environ["HOF_DATABASE_URL"])
        loop = asyncio.get_running_loop()
        record, functions, answer = await loop.run_in_executor(self._executor, self._work.encode, image)
        await self._store.put(record, functions)
        return answer
