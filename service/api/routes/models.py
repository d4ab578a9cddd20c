"""The loaded models."""

from typing import Annotated

from fastapi import APIRouter, Query

from service.api.dependencies import ReadyRuntime
from service.api.queries import ModelQuery, NoQuery
from service.api.responses.models import Model, ModelList

router = APIRouter(tags=["model"])


@router.get("/model")
async def model(query: Annotated[ModelQuery, Query()], runtime: ReadyRuntime) -> Model:
    """Return a loaded model: its card, the spec of its thetas, and how it frames images."""
    return Model.of(runtime.models.named(query.model))


@router.get("/models")
async def models(query: Annotated[NoQuery, Query()], runtime: ReadyRuntime) -> ModelList:
    """List the loaded models, the default one first."""
    return ModelList(models=[Model.of(encoder) for encoder in runtime.models])
