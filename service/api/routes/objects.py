"""The stored objects: list them, read one, label one, remove one."""

from typing import Annotated, Final

from fastapi import APIRouter, Query
from starlette.requests import Request

from service.api.context import client_of
from service.api.dependencies import ObjectId, ReadyRuntime
from service.api.queries import Label, NoQuery, PageQuery
from service.api.responses.errors import BODY_STALLED, NO_SPACE, OBJECT_NOT_FOUND, OVERLOADED, Problem
from service.api.responses.objects import ObjectPage, StoredObject
from service.api.wire.json_bodies import read_json
from service.runtime.frames import complete_record

router = APIRouter(prefix="/objects", tags=["objects"])

MAX_BODY_BYTES: Final = 4096


@router.get("")
async def page_of_objects(query: Annotated[PageQuery, Query()], runtime: ReadyRuntime) -> ObjectPage:
    """List the stored objects, newest first. Objects that are added meanwhile do not shift the pages."""
    records, cursor = await runtime.store.page(query.limit, query.cursor)
    items = [StoredObject.of(record, runtime.settings.root_path) for record in records]
    return ObjectPage(items=items, next=cursor, limit=query.limit)


@router.get("/{id}", responses=OBJECT_NOT_FOUND | {429: OVERLOADED})
async def one_object(
    request: Request, id_: ObjectId, query: Annotated[NoQuery, Query()], runtime: ReadyRuntime
) -> StoredObject:
    """Return one object."""
    record, _ = await complete_record(runtime, await runtime.store.record(id_), client=client_of(request.scope))
    return StoredObject.of(record, runtime.settings.root_path)


@router.patch(
    "/{id}",
    responses=OBJECT_NOT_FOUND
    | {
        400: {"model": Problem, "description": "The body is not JSON"},
        408: BODY_STALLED,
        413: {"model": Problem, "description": "More bytes than such a call can need"},
        507: NO_SPACE | {"description": "The store has no space left; the label is as it was"},
        429: OVERLOADED,
    },
    openapi_extra={
        "requestBody": {"required": True, "content": {"application/json": {"schema": Label.model_json_schema()}}}
    },
)
async def label_object(
    request: Request, id_: ObjectId, query: Annotated[NoQuery, Query()], runtime: ReadyRuntime
) -> StoredObject:
    """Give an object another label, or none. Of concurrent calls the last one counts; its function never changes."""
    body = await read_json(request, Label, MAX_BODY_BYTES)
    return StoredObject.of(await runtime.store.relabel(id_, body.label), runtime.settings.root_path)


@router.delete(
    "/{id}",
    status_code=204,
    responses=OBJECT_NOT_FOUND
    | {
        409: {"model": Problem, "description": "Composed objects, which `detail` names, use it"},
        507: {"model": Problem, "description": "The store has no space left, not even to remove; the object is kept"},
    },
)
async def delete_object(id_: ObjectId, query: Annotated[NoQuery, Query()], runtime: ReadyRuntime) -> None:
    """Remove an object, unless the word of a composed object names it. Interpolated objects outlive their parents."""
    await runtime.store.delete(id_)
