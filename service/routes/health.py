"""Probes, and what the service serves with."""

from dataclasses import asdict
from typing import Annotated

from fastapi import APIRouter, Query
from starlette.requests import Request

from service.errors import NotReady
from service.queries import NoQuery
from service.runtime import Ready
from service.schemas import Health, Model, ModelFraming, Spec

router = APIRouter()


@router.get("/health/live", tags=["health"])
async def live(query: Annotated[NoQuery, Query()]) -> Health:
    """The process answers. Touches neither worker threads nor the store."""
    return Health(status="live")


@router.get("/health/ready", tags=["health"])
async def ready(request: Request, query: Annotated[NoQuery, Query()], runtime: Ready) -> Health:
    """The service is not about to stop, and encoder and store answer: asked, under load they may take their time."""
    if getattr(request.state, "draining", False):
        raise NotReady("the service is stopping")
    for name, vital in runtime.vitals.items():
        if not await vital.works():
            raise NotReady(f"the {name} does not answer")
    return Health(status="ready")


@router.get("/model", tags=["model"])
async def model(query: Annotated[NoQuery, Query()], runtime: Ready) -> Model:
    """The loaded model: its card, the specs of its thetas and colours, and how it frames images."""
    encoder = runtime.encoder
    return Model(
        name=encoder.name,
        digest=encoder.digest,
        spec=Spec.of(encoder.spec),
        color=Spec.of(encoder.color_spec) if encoder.color_spec else None,
        framing=ModelFraming(**asdict(encoder.framing)),
        card=encoder.card,
    )
