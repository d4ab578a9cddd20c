"""LitServe: its batching with the same batch as ours, the store in its worker process."""

import asyncio
import os
import sys
from typing import Annotated, Any

import litserve
from fastapi import Body

from benchmarks.load.peers.work import Work
from service.runtime.batcher import MAX_BATCH
from service.storage.store import Store


class Api(litserve.LitAPI):  # type: ignore[misc]
    """Server that turns a photo into a stored theta."""

    def setup(self, device: str) -> None:
        """Load the model, open the store."""
        self._work = Work()
        self._loop = asyncio.new_event_loop()
        self._store = self._loop.run_until_complete(Store.open(os.environ["HOF_DATABASE_URL"]))

    def decode_request(self, request: Annotated[bytes, Body()]) -> bytes:
        """Return the photo's bytes."""
        return request

    def batch(self, inputs: list[bytes]) -> list[bytes]:
        """Return the list unchanged."""
        return list(inputs)

    def predict(self, inputs: list[bytes]) -> list[dict[str, Any]]:
        """Encode all photos in one call and store the objects."""
        objects = self._work.encode_all(inputs)
        self._loop.run_until_complete(self._put(objects))
        return [answer for _, _, answer in objects]

    async def _put(self, objects: list[Any]) -> None:
        await asyncio.gather(*(self._store.put(record, functions) for record, functions, _ in objects))

    def unbatch(self, output: list[dict[str, Any]]) -> list[dict[str, Any]]:
        """Return the list unchanged."""
        return output

    def encode_response(self, output: dict[str, Any]) -> dict[str, Any]:
        """Return the answer, which is JSON already."""
        return output


if __name__ == "__main__":
    api = Api(max_batch_size=MAX_BATCH, batch_timeout=0.001, api_path="/encode")
    server = litserve.LitServer(api, accelerator="cpu", workers_per_device=1, timeout=60)
    server.run(
        port=int(sys.argv[1]), host="127.0.0.1", num_api_servers=1, generate_client_file=False, log_level="warning"
    )
