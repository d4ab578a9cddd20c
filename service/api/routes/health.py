"""Probes: liveness and readiness."""

from collections.abc import Mapping
from typing import Annotated, Literal

from fastapi import APIRouter, Query
from pydantic import BaseModel
from starlette.requests import Request

from service.api.dependencies import ReadyRuntime
from service.api.queries import NoQuery
from service.errors import NotReady
from service.runtime.liveness import LivenessProbe

router = APIRouter(prefix="/health", tags=["health"])


class Health(BaseModel):
    """The answer to a probe."""

    status: Literal["live", "ready"]


async def check_ready(request: Request, probes: Mapping[str, LivenessProbe]) -> None:
    """Raise NotReady if the service is about to stop, or if one of these parts does not answer."""
    if getattr(request.state, "draining", False):
        raise NotReady("the service is stopping")
    for name, probe in probes.items():
        if not await probe.is_alive():
            raise NotReady(f"the {name} does not answer")


@router.get("/live")
async def live(query: Annotated[NoQuery, Query()]) -> Health:
    """Show that the process answers. Uses neither worker threads nor the store."""
    return Health(status="live")


@router.get("/ready")
async def ready(request: Request, query: Annotated[NoQuery, Query()], runtime: ReadyRuntime) -> Health:
    """Show that the service is not about to stop, and that its models and its store answer.

    A busy model may take its time to answer and still counts as ready.
    """
    await check_ready(request, runtime.probes)
    return Health(status="ready")
