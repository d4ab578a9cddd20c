"""The stored objects: list them, read one, remove one."""

from typing import Annotated

from fastapi import APIRouter, Query
from starlette.requests import Request

from service.api.context import client_of
from service.api.dependencies import ObjectId, ReadyRuntime
from service.api.queries import NoQuery, PageQuery
from service.api.responses.errors import OBJECT_NOT_FOUND, OVERLOADED, Problem
from service.api.responses.objects import ObjectPage, StoredObject
from service.runtime.frames import complete_record

router = APIRouter(prefix="/objects", tags=["objects"])


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
