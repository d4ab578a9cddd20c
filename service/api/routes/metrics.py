"""GET /metrics: metrics for Prometheus."""

import asyncio
from typing import Annotated, Final

from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import Response

from service.api.queries import NoQuery
from service.telemetry.metrics import Metrics

router = APIRouter()

TEXT: Final = {"schema": {"type": "string"}}


@router.get(
    "/metrics",
    tags=["health"],
    response_class=Response,
    responses={200: {"description": "Counters and histograms, by route", "content": {"text/plain": TEXT}}},
)
async def metrics(request: Request, query: Annotated[NoQuery, Query()]) -> Response:
    """Return the metrics of all worker processes in Prometheus's text format.

    Uses neither the threads that encode and sample nor the store.
    """
    registry: Metrics = request.app.state.metrics
    content, media_type = await asyncio.to_thread(registry.exposition, request.headers.get("accept", ""))
    return Response(content, headers={"Content-Type": media_type, "Cache-Control": "no-store"})
