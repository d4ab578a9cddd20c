"""Probes, and what the service serves with."""

from collections.abc import Mapping
from typing import Annotated

from fastapi import APIRouter, Query
from starlette.requests import Request

from service.api.queries import ModelQuery, NoQuery
from service.api.responses import Health, Model, ModelList
from service.errors import NotReady
from service.runtime.liveness import Vital
from service.runtime.parts import Ready

router = APIRouter()


async def check(request: Request, vitals: Mapping[str, Vital]) -> None:
    """Raises NotReady where the service is about to stop, or one of these parts does not answer."""
    if getattr(request.state, "draining", False):
        raise NotReady("the service is stopping")
    for name, vital in vitals.items():
        if not await vital.works():
            raise NotReady(f"the {name} does not answer")


@router.get("/health/live", tags=["health"])
async def live(query: Annotated[NoQuery, Query()]) -> Health:
    """The process answers. Touches neither worker threads nor the store."""
    return Health(status="live")


@router.get("/health/ready", tags=["health"])
async def ready(request: Request, query: Annotated[NoQuery, Query()], runtime: Ready) -> Health:
    """The service is not about to stop, and encoder and store answer: asked, under load they may take their time."""
    await check(request, runtime.vitals)
    return Health(status="ready")


@router.get("/model", tags=["model"])
async def model(query: Annotated[ModelQuery, Query()], runtime: Ready) -> Model:
    """A loaded model: its card, the spec of its thetas, and how it frames images."""
    return Model.of(runtime.models.named(query.model))


@router.get("/models", tags=["model"])
async def models(query: Annotated[NoQuery, Query()], runtime: Ready) -> ModelList:
    """All loaded models, the default one first."""
    return ModelList(models=[Model.of(encoder) for encoder in runtime.models])
