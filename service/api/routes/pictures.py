"""Pictures of an object, as files: drawn from its surface, or cut out of its photo."""

from typing import Annotated

from fastapi import APIRouter, Query
from starlette.requests import Request
from starlette.responses import Response

from service.api.context import client_of
from service.api.dependencies import ObjectId, ReadyRuntime
from service.api.queries import NoQuery, PictureQuery, parameters_of, read_query
from service.api.responses.errors import Problem
from service.api.routes.file_answers import NOT_ACCEPTABLE, FileAnswer, file_responses, format_of
from service.errors import InvalidParameter, NotFound
from service.formats.picture import PICTURE_FORMATS, PictureFormat
from service.runtime.frames import complete_record
from service.runtime.pictures import TURN_MS, check_turntable, draw_frame, picture_cost, scene_of

router = APIRouter(prefix="/objects", tags=["objects"])


@router.get(
    "/{id}/picture",
    response_class=Response,
    responses=file_responses("The picture in the chosen format", PICTURE_FORMATS.values()) | NOT_ACCEPTABLE,
    openapi_extra={"parameters": parameters_of(PictureQuery)},
)
async def picture(request: Request, id_: ObjectId, runtime: ReadyRuntime) -> Response:
    """Draw the object's surface in soft light over white, in its colors if it has any; still, or turning once."""
    query = read_query(request, PictureQuery)
    fmt = _format_of(request, query)
    check_turntable(query)
    record, frame = await complete_record(runtime, await runtime.store.record(id_), client=client_of(request.scope))
    answer = FileAnswer(id_, fmt, "picture", fmt.name, query.model_dump(exclude={"format"}), frame, vary="Accept")
    if response := answer.without_file(request):
        return response

    async def compute() -> bytes:
        _, functions = await runtime.store.get(id_)
        scene = await runtime.run(scene_of, record.spec, functions, frame, query)
        pictures = [await runtime.run(draw_frame, scene, query, index) for index in range(query.frames)]
        return await runtime.run(fmt.dump, pictures, TURN_MS // query.frames)

    return answer.with_file(compute, runtime.gates.points, picture_cost(record, query))


@router.get(
    "/{id}/photo",
    response_class=Response,
    responses=file_responses("A small picture of the object in its photo", [PICTURE_FORMATS["webp"]])
    | {404: {"model": Problem, "description": "No object of that id, or it has no photo"}},
)
async def photo(request: Request, id_: ObjectId, query: Annotated[NoQuery, Query()], runtime: ReadyRuntime) -> Response:
    """Return the object as its photo shows it, 160 pixels wide, if `keep_photo=true` asked to keep that."""
    content = await runtime.store.photo(id_)
    if content is None:
        await runtime.store.record(id_)
        raise NotFound(f"the object {id_} has no photo; only photos encoded with keep_photo=true leave one")
    answer = FileAnswer(id_, PICTURE_FORMATS["webp"], "photo", length=len(content))
    return answer.without_file(request) or Response(content, headers=answer.headers, media_type=answer.media_type)


def _format_of(request: Request, query: PictureQuery) -> PictureFormat:
    """Return the format to write. Raises NotAcceptable, or InvalidParameter if it holds a single picture only."""
    formats = {name: fmt for name, fmt in PICTURE_FORMATS.items() if fmt.moves or query.frames == 1}
    if query.format and query.format not in formats:
        detail = f"{query.format} holds one picture, frames is {query.frames}: use format={' or '.join(formats)}"
        raise InvalidParameter(detail, field="format")
    return format_of(request, query.format, formats)
