"""A minimal server: FastAPI, onnxruntime on a worker thread, the same framing and store."""

import asyncio
import os
import sys
from collections.abc import AsyncIterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import asynccontextmanager
from typing import Any

import uvicorn
from fastapi import FastAPI, Request

from benchmarks.load.peers.work import Work
from service.storage.store import Store


@asynccontextmanager
async def lifespan(app: FastAPI) -> AsyncIterator[None]:
    """Load the model, open the store."""
    app.state.work = Work()
    app.state.store = await Store.open(os.environ["HOF_DATABASE_URL"])
    with ThreadPoolExecutor(1) as executor:
        app.state.executor = executor
        yield
    await app.state.store.close()


app = FastAPI(lifespan=lifespan)


@app.get("/health/ready")
async def ready() -> dict[str, str]:
    """Answer that the server is up."""
    return {"status": "ready"}


@app.post("/encode", status_code=201)
async def encode(request: Request) -> dict[str, Any]:
    """Server that turns a photo into a stored theta."""
    image = await request.body()
    loop = asyncio.get_running_loop()
    work: Work = app.state.work
    record, functions, answer = await loop.run_in_executor(app.state.executor, work.encode, image)
    await app.state.store.put(record, functions)
    return answer


if __name__ == "__main__":
    uvicorn.run(app, port=int(sys.argv[1]), log_level="warning")
