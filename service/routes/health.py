"""Probes, and what the service serves with."""

from dataclasses import asdict
from typing import Annotated

from fastapi import APIRouter, Query
from sqlalchemy.exc import SQLAlchemyError

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
async def ready(query: Annotated[NoQuery, Query()], runtime: Ready) -> Health:
    """The encoder is loaded and warm, and the store answers."""
    try:
        await runtime.store.ping()
    except (SQLAlchemyError, OSError) as error:
        raise NotReady("the store does not answer") from error
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
